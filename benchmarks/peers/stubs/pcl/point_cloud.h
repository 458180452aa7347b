#pragma once
#include <vector>
namespace pcl {
struct alignas(16) PointXYZI {  // laid out as PCL's
    float x, y, z, unused, intensity, padding[3];
};
template <typename Point>
struct PointCloud {
    std::vector<Point> points;
};
}  // namespace pcl
