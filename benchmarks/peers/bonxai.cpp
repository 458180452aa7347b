// Times Bonxai's ProbabilisticMap, one thread, CPU time; benchmarks/PEERS.md says how to build it.
//   bonxai POINTS SCANS ORIGINS LEAF_M RANGE_M
// POINTS are float32 x y z of scans of as many points each, ORIGINS float32 x y z of the sensor at each, both in the world.
// Prints milliseconds a scan, the median of five passes into one map after two that do not count, and the map's megabytes.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <vector>
#include "bonxai_map/probabilistic_map.hpp"

static double cpu_ms() {
    timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return now.tv_sec * 1e3 + now.tv_nsec * 1e-6;
}

static std::vector<Eigen::Vector3d> read(const char *path) {
    std::ifstream file(path, std::ios::binary);
    std::vector<Eigen::Vector3d> points;
    for (float xyz[3]; file.read(reinterpret_cast<char *>(xyz), sizeof xyz);) points.emplace_back(xyz[0], xyz[1], xyz[2]);
    return points;
}

int main(int, char **words) {
    const std::vector<Eigen::Vector3d> points = read(words[1]), origins = read(words[3]);
    const size_t scans = atoi(words[2]), size = points.size() / scans;
    std::vector<std::vector<Eigen::Vector3d>> clouds;
    for (size_t i = 0; i < scans; i++) clouds.emplace_back(points.begin() + i * size, points.begin() + (i + 1) * size);
    Bonxai::ProbabilisticMap map(atof(words[4]));
    std::vector<double> took;
    for (int pass = 0; pass < 7; pass++) {
        const double start = cpu_ms();
        for (size_t i = 0; i < scans; i++) map.insertPointCloud(clouds[i], origins[i], atof(words[5]));
        if (pass >= 2) took.push_back((cpu_ms() - start) / scans);
    }
    std::nth_element(took.begin(), took.begin() + took.size() / 2, took.end());
    printf("%.6f %.3f\n", took[took.size() / 2], map.grid().memUsage() * 1e-6);
}
