// Lindstrom-Turk simplification by CGAL, as a peer to compare with.
//
// Reads and writes a raw mesh: two u64 (vertices, triangles), f64 x 3 a vertex, u32 x 3 a triangle,
// little-endian. Usage: cgal_lt IN OUT TRIANGLES, or cgal_lt --version. Prints one JSON object: seconds, CPU
// seconds and further memory of the simplification alone.
// Build: g++ -O3 -DNDEBUG -march=native cgal_lt.cpp -o cgal_lt -lgmp -lmpfr
// Non-manifold input is refused by CGAL's mesh; such triangles are left out and counted.

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <vector>

#include <CGAL/Simple_cartesian.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Count_stop_predicate.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/LindstromTurk_cost.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/LindstromTurk_placement.h>
#include <CGAL/Surface_mesh_simplification/edge_collapse.h>
#include <CGAL/version.h>

namespace sms = CGAL::Surface_mesh_simplification;
using Kernel = CGAL::Simple_cartesian<double>;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;

// A field of /proc/self/status in bytes.
static long status(const char* field) {
    long kib = 0;
    char line[256];
    std::FILE* file = std::fopen("/proc/self/status", "r");
    while (file && std::fgets(line, sizeof line, file)) {
        if (!std::strncmp(line, field, std::strlen(field))) kib = std::atol(line + std::strlen(field));
    }
    if (file) std::fclose(file);
    return kib * 1024;
}

int main(int argc, char** argv) {
    if (argc == 2 && !std::strcmp(argv[1], "--version")) {
        std::puts(CGAL_VERSION_STR);
        return 0;
    }
    if (argc != 4) return 2;
    std::FILE* in = std::fopen(argv[1], "rb");
    if (!in) return 1;
    std::uint64_t counts[2];
    if (std::fread(counts, 8, 2, in) != 2) return 1;
    std::vector<double> positions(counts[0] * 3);
    std::vector<std::uint32_t> corners(counts[1] * 3);
    if (std::fread(positions.data(), 8, positions.size(), in) != positions.size()) return 1;
    if (std::fread(corners.data(), 4, corners.size(), in) != corners.size()) return 1;
    std::fclose(in);

    // Memory counts from here: the input lies in arrays, CGAL's own structure is yet to be built.
    if (std::FILE* peak = std::fopen("/proc/self/clear_refs", "w")) {
        std::fputs("5", peak);
        std::fclose(peak);
    }
    const long before = status("VmRSS:");
    Mesh mesh;
    std::vector<Mesh::Vertex_index> id(counts[0]);
    for (std::size_t v = 0; v < counts[0]; ++v) {
        const double* p = &positions[v * 3];
        id[v] = mesh.add_vertex({p[0], p[1], p[2]});
    }
    std::size_t refused = 0;
    for (std::size_t t = 0; t < counts[1]; ++t) {
        const std::uint32_t* c = &corners[t * 3];
        if (mesh.add_face(id[c[0]], id[c[1]], id[c[2]]) == Mesh::null_face()) ++refused;
    }

    // The stop predicate counts edges; a triangle more or less is made up for by trying again.
    const std::size_t target = std::strtoull(argv[3], nullptr, 10);
    const std::clock_t cpu = std::clock();
    const auto begin = std::chrono::steady_clock::now();
    std::size_t edges = target * 3 / 2;
    std::size_t faces = mesh.number_of_faces();
    while (faces > target) {
        sms::Count_stop_predicate<Mesh> stop(edges);
        const int n = sms::edge_collapse(mesh, stop,
                                         CGAL::parameters::get_cost(sms::LindstromTurk_cost<Mesh>())
                                             .get_placement(sms::LindstromTurk_placement<Mesh>()));
        faces = mesh.number_of_faces();
        // With edges left above the stop, everything else was refused: trying again would refuse it again.
        if (n == 0 || edges < 8 || mesh.number_of_edges() > edges) break;
        const std::size_t excess = faces > target ? faces - target : 0;
        edges -= excess + (excess > 0 ? 1 : 0);
    }
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
    const double cpu_seconds = double(std::clock() - cpu) / CLOCKS_PER_SEC;
    const long extra = status("VmHWM:") - before;
    mesh.collect_garbage();

    std::FILE* out = std::fopen(argv[2], "wb");
    if (!out) return 1;
    const std::uint64_t left[2] = {mesh.number_of_vertices(), mesh.number_of_faces()};
    std::fwrite(left, 8, 2, out);
    for (auto v : mesh.vertices()) {
        const auto& p = mesh.point(v);
        const double xyz[3] = {p.x(), p.y(), p.z()};
        std::fwrite(xyz, 8, 3, out);
    }
    for (auto f : mesh.faces()) {
        std::uint32_t c[3];
        int i = 0;
        for (auto v : CGAL::vertices_around_face(mesh.halfedge(f), mesh)) c[i++] = v;
        std::fwrite(c, 4, 3, out);
    }
    std::fclose(out);
    std::printf("{\"seconds\": %.6f, \"cpu_seconds\": %.6f, \"extra_bytes\": %ld, \"refused\": %zu}\n",
                seconds.count(), cpu_seconds, extra, refused);
    return 0;
}
