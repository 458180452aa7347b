% The authors' M2DP of each scan: octave-cli --path M2DP --path benchmarks/peers/stubs m2dp.m POINTS SCANS OUT
words = argv();
file = fopen(words{1}, "r", "ieee-le");
numbers = fread(file, Inf, "single=>double");
fclose(file);
scans = str2double(words{2});
clouds = permute(reshape(numbers, 3, [], scans), [2 1 3]);
M2DP(clouds(:, :, 1));
took = zeros(1, scans);
signatures = zeros(192, scans);
for scan = 1:scans
    start = cputime();
    signatures(:, scan) = M2DP(clouds(:, :, scan));
    took(scan) = cputime() - start;
end
file = fopen(words{3}, "w", "ieee-le");
fwrite(file, signatures, "single");
fclose(file);
printf("%g\n", 1000 * median(took));
