% Principal axes (3, 3) of points (n, 3) in columns, the longest first, as Matlab's toolbox has it: of each axis the largest number
% is positive.
function axes = pca(points)
    [axes, spread] = eig(cov(points));
    [~, order] = sort(diag(spread), "descend");
    axes = axes(:, order);
    [~, largest] = max(abs(axes));
    axes = axes .* sign(axes(sub2ind(size(axes), largest, 1:3)));
end
