#pragma once
#include <memory>
#include <nanoflann.hpp>
#include <vector>
// What the peer takes from nanoflann's examples: an index over rows of numbers.
template <typename Rows, typename Number>
struct KDTreeVectorOfVectorsAdaptor {
    using Self = KDTreeVectorOfVectorsAdaptor;
    using Index = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Adaptor<Number, Self>, Self, -1, size_t>;
    const Rows &rows;
    std::unique_ptr<Index> index;
    KDTreeVectorOfVectorsAdaptor(size_t width, const Rows &rows, int leaf) : rows(rows) {
        index = std::make_unique<Index>(int(width), *this, nanoflann::KDTreeSingleIndexAdaptorParams(leaf));
        index->buildIndex();
    }
    size_t kdtree_get_point_count() const { return rows.size(); }
    Number kdtree_get_pt(size_t row, size_t column) const { return rows[row][column]; }
    template <typename Box>
    bool kdtree_get_bbox(Box &) const { return false; }
};
