// Simplification by CGAL within a polyhedral envelope, for tools/bound_peers.py.
//
//   g++ -O3 -DNDEBUG -I/usr/include/eigen3 cgal_envelope.cpp -o cgal_envelope -lgmp -lmpfr
//   cgal_envelope IN.obj OUT.obj EPSILON

#include <CGAL/Polygon_mesh_processing/IO/polygon_mesh_io.h>
#include <CGAL/Simple_cartesian.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Count_stop_predicate.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/GarlandHeckbert_plane_policies.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Bounded_normal_change_filter.h>
#include <CGAL/Surface_mesh_simplification/Policies/Edge_collapse/Polyhedral_envelope_filter.h>
#include <CGAL/Surface_mesh_simplification/edge_collapse.h>
#include <cstdlib>

namespace SMS = CGAL::Surface_mesh_simplification;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;

int main(int, char** words) {
    Mesh mesh;
    if (!CGAL::Polygon_mesh_processing::IO::read_polygon_mesh(words[1], mesh)) return 1;
    using Policies = SMS::GarlandHeckbert_plane_policies<Mesh, Kernel>;
    Policies policies(mesh);
    using Inner = SMS::Bounded_normal_change_filter<>;
    SMS::Polyhedral_envelope_filter<Kernel, Inner> filter(std::atof(words[3]), Inner());
    SMS::Count_stop_predicate<Mesh> stop(0);
    SMS::edge_collapse(mesh, stop,
                       CGAL::parameters::get_cost(policies.get_cost())
                           .get_placement(policies.get_placement())
                           .filter(filter));
    mesh.collect_garbage();
    return CGAL::IO::write_polygon_mesh(words[2], mesh, CGAL::parameters::stream_precision(17)) ? 0 : 1;
}
