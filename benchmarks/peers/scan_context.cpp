// Times the Scan Context of its authors, one thread, CPU time, and writes what it found; benchmarks/PEERS.md says how to build it.
//   scan_context draw POINTS SCANS OUT            OUT: float32 images (scan, sector, ring)
//   scan_context search IMAGES ROWS QUERIES OUT   OUT: float32 nearest row and distance of each query
// POINTS are float32 x y z of scans of as many points each; IMAGES float32 (row, ring, sector), the queries last.
// Prints the median milliseconds of a scan or query.
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>
#include <sstream>
#include <string>
#include "Scancontext.h"

static double cpu_ms() {
    timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return now.tv_sec * 1e3 + now.tv_nsec * 1e-6;
}

static std::vector<float> read(const char *path) {
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    std::vector<float> numbers(file.tellg() / sizeof(float));
    file.seekg(0).read(reinterpret_cast<char *>(numbers.data()), numbers.size() * sizeof(float));
    return numbers;
}

static std::vector<double> draw(SCManager &manager, const std::vector<float> &xyz, size_t scans, std::vector<float> &found) {
    const size_t points = xyz.size() / 3 / scans, rounds = 6;
    std::vector<pcl::PointCloud<SCPointType>> clouds(scans);
    for (size_t i = 0; i < scans; i++)
        for (size_t j = 0; j < points; j++) {
            const float *at = &xyz[(i * points + j) * 3];
            clouds[i].points.push_back({at[0], at[1], at[2]});
        }
    std::vector<double> took;
    for (size_t i = 0; i < scans * rounds; i++) {
        const double start = cpu_ms();
        const MatrixXd image = manager.makeScancontext(clouds[i % scans]);
        took.push_back(cpu_ms() - start);
        if (i < scans) found.insert(found.end(), image.data(), image.data() + image.size());
    }
    return took;
}

static std::vector<double> search(SCManager &manager, const std::vector<float> &images, int rows, int queries,
                                  std::vector<float> &found) {
    auto add = [&](int row) {
        MatrixXd image(manager.PC_NUM_RING, manager.PC_NUM_SECTOR);
        for (int r = 0; r < image.rows(); r++)
            for (int s = 0; s < image.cols(); s++) image(r, s) = images[(size_t(row) * image.rows() + r) * image.cols() + s];
        manager.polarcontexts_.push_back(image);
        manager.polarcontext_invkeys_mat_.push_back(eig2stdvec(manager.makeRingkeyFromScancontext(image)));
    };
    for (int row = 0; row < rows; row++) add(row);
    for (int i = 1; i < manager.NUM_EXCLUDE_RECENT; i++) add(0);  // the newest ones, of which the query is one, are not searched
    std::vector<double> took;
    for (int query = 0; query < queries; query++) {
        add(rows + query);
        std::ostringstream said;
        std::streambuf *before = cout.rdbuf(said.rdbuf());  // it prints the nearest and its distance, in three digits
        if (query == 0) manager.detectLoopClosureID();      // makes the tree
        manager.tree_making_period_conter = 1;
        said.str("");
        const double start = cpu_ms();
        manager.detectLoopClosureID();
        took.push_back(cpu_ms() - start);
        cout.rdbuf(before);
        const std::string text = said.str(), distance = "distance: ", and_ = " and ";
        found.push_back(std::stof(text.substr(text.find(and_) + and_.size())));
        found.push_back(std::stof(text.substr(text.find(distance) + distance.size())));
        manager.polarcontexts_.pop_back();
        manager.polarcontext_invkeys_mat_.pop_back();
    }
    return took;
}

int main(int, char **words) {
    SCManager manager;
    std::vector<float> found;
    const bool drawing = !strcmp(words[1], "draw");
    const std::vector<float> given = read(words[2]);
    std::vector<double> took =
        drawing ? draw(manager, given, atoi(words[3]), found) : search(manager, given, atoi(words[3]), atoi(words[4]), found);
    std::ofstream file(words[drawing ? 4 : 5], std::ios::binary);
    file.write(reinterpret_cast<char *>(found.data()), found.size() * sizeof(float));
    std::nth_element(took.begin(), took.begin() + took.size() / 2, took.end());
    printf("%.6f\n", took[took.size() / 2]);
}
