#!/usr/bin/env python3
"""Reads files that other programs wrote, and holds what stonecut finds in them against what those programs say.

    python3 -m venv V; V/bin/pip install bpy cadquery gmsh meshio numpy-stl open3d pillow plyfile pymeshlab pyvista trimesh vtk pygltflib
    npm install --prefix N three babylonjs babylonjs-serializers @gltf-transform/core @gltf-transform/extensions \\
        @gltf-transform/functions draco3dgltf meshoptimizer gltfpack obj2gltf ktx2-encoder sharp @jscad/modeling @jscad/stl-serializer @jscad/obj-serializer
    apt-get install admesh assimp-utils draco meshlab openctm-tools openscad
    V/bin/python tools/written_by_others.py STONECUT FOLDER N/node_modules

Every program writes its files into FOLDER from one mesh (a bumpy ball with colours, normals, texture coordinates and an image; a scene
of it where the format has nodes), then says what it holds: triangles, box, area, mean colour of corners (sRGB of 0 to 255), images.
A textured file is drawn as well, and must look as the first mesh does. Programs that are not installed are left out. Files of crates
under ~/.cargo and of PyPI packages are read, too. One table; what differs goes to standard error, with exit code 1.
"""

import glob
import importlib.metadata
import json
import os
import shutil
import subprocess
import sys
import tempfile

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
WRITERS = {}


def writer(function):
    WRITERS[function.__name__.replace("_", " ")] = function
    return function


def facts(corners, colours=None, images=None, **more):
    """What a mesh of triangle corners (n, 3, 3) holds; colours at corners, of 0 to 255."""
    corners = np.asarray(corners, float).reshape(-1, 3, 3)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
    out = dict(triangles=len(corners), box=[corners.min((0, 1)).tolist(), corners.max((0, 1)).tolist()], area=float(area), **more)
    if colours is not None:
        out["colour"] = np.asarray(colours, float).reshape(-1, 3).mean(0).tolist()
    if images is not None:
        out["images"] = images
    return out


def indexed(vertices, triangles, colours=None, images=None, **more):
    triangles = np.asarray(triangles).reshape(-1, 3)
    colours = None if colours is None else np.asarray(colours)[:, :3][triangles]
    return facts(np.asarray(vertices)[triangles], colours, images, **more)


class Base:
    """The mesh that all programs write."""

    def __init__(self, folder):
        n, m = 24, 32
        i, j = (a.reshape(-1) for a in np.meshgrid(np.arange(n + 1), np.arange(m + 1), indexing="ij"))
        theta, phi = np.pi * (0.02 + 0.96 * i / n), 2 * np.pi * (j % m) / m
        radius = 1 + 0.2 * np.sin(3 * theta) * np.cos(4 * phi)
        self.v = np.stack([radius * np.sin(theta) * np.cos(phi) + 3, radius * np.cos(theta) * 1.5, radius * np.sin(theta) * np.sin(phi) - 1], 1)
        self.n = (self.v - [3, 0, -1]) / np.linalg.norm(self.v - [3, 0, -1], axis=1)[:, None]
        self.uv = np.stack([0.05 + 0.9 * j / m, 0.05 + 0.9 * i / n], 1)
        self.c = np.stack([200 * i / n + 20, 90 + 80 * np.sin(phi), 40 + 150 * j / m], 1).astype(np.uint8)
        at = np.arange((n + 1) * (m + 1)).reshape(n + 1, m + 1)
        a, b, c, d = at[:-1, :-1].ravel(), at[:-1, 1:].ravel(), at[1:, 1:].ravel(), at[1:, :-1].ravel()
        self.t, self.q = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]), np.stack([a, b, c, d], 1)
        self.v32 = self.v.astype(np.float32)
        self.png = os.path.join(folder, "base.png")
        from PIL import Image
        y, x = np.mgrid[:96, :128]
        Image.fromarray(np.stack([x * 2, y * 2.5, 128 + 0 * x], 2).astype(np.uint8)).save(self.png)
        self.obj = os.path.join(folder, "base.obj")
        with open(self.obj, "w") as out:
            out.write("mtllib base.mtl\n" + "".join("v %.7g %.7g %.7g\n" % tuple(p) for p in self.v32))
            out.write("".join("vt %.6f %.6f\n" % tuple(p) for p in self.uv) + "".join("vn %.5f %.5f %.5f\n" % tuple(p) for p in self.n) + "usemtl skin\n")
            out.write("".join("f " + " ".join(f"{k}/{k}/{k}" for k in face + 1) + "\n" for face in self.t))
        with open(os.path.join(folder, "base.mtl"), "w") as out:
            out.write("newmtl skin\nKd 1 1 1\nmap_Kd base.png\n")
        self.ply = os.path.join(folder, "base.ply")
        from plyfile import PlyData, PlyElement
        rows = np.rec.fromarrays([*self.v32.T, *self.c.T], names="x,y,z,red,green,blue")
        faces = np.empty(len(self.t), dtype=[("vertex_indices", "i4", (3,))])
        faces["vertex_indices"] = self.t
        PlyData([PlyElement.describe(rows, "vertex"), PlyElement.describe(faces, "face")]).write(self.ply)
        json.dump(dict(v=self.v32.tolist(), n=self.n.tolist(), uv=self.uv.tolist(), c=self.c.tolist(), t=self.t.tolist()),
                  open(os.path.join(folder, "base.json"), "w"))


@writer
def trimesh(base, folder):
    import trimesh
    coloured = lambda: trimesh.Trimesh(base.v32, base.t, vertex_colors=base.c, process=False)
    for name, words in [("t.ply", {}), ("ta.ply", dict(encoding="ascii")), ("t.stl", {}), ("ta.stl", dict(file_type="stl_ascii")),
                        ("t.obj", {}), ("t.glb", {})]:
        path = os.path.join(folder, name)
        coloured().export(path, **words)
        mesh = trimesh.load(path, process=False, force="mesh")
        has = name.endswith((".ply", ".obj", ".glb"))
        yield path, indexed(mesh.vertices, mesh.faces, mesh.visual.vertex_colors if has else None, linear=name.endswith(".glb"))
    from PIL import Image
    white = trimesh.visual.material.SimpleMaterial(image=Image.open(base.png), diffuse=[255, 255, 255, 255])
    skin = trimesh.visual.TextureVisuals(uv=base.uv, material=white)
    scene = trimesh.Scene()
    for k in range(3):
        move = trimesh.transformations.compose_matrix(angles=(0.3 * k, 0.2, 0.5 * k), translate=(4 * k, 0, k), scale=(1, 1 + k, 1))
        scene.add_geometry(trimesh.Trimesh(base.v32, base.t, visual=skin.copy(), process=False), transform=move)
    scene.export(os.path.join(folder, "scene.glb"))
    scene = trimesh.load(os.path.join(folder, "scene.glb"), process=False).to_geometry()
    yield os.path.join(folder, "scene.glb"), indexed(scene.vertices, scene.faces, images=1)
    os.makedirs(os.path.join(folder, "tex"), exist_ok=True)
    for name in ["tex/skin.obj", "tex/skin.glb", "tex/skin.ply"]:
        path = os.path.join(folder, name)
        trimesh.Trimesh(base.v32, base.t, visual=skin.copy(), process=False).export(path)
        mesh = trimesh.load(path, process=False, force="mesh")
        yield path, indexed(mesh.vertices, mesh.faces, images=0 if name.endswith("ply") else 1, drawn=not name.endswith("ply"))


@writer
def open3d(base, folder):
    import open3d
    io, utility = open3d.io, open3d.utility
    mesh = open3d.geometry.TriangleMesh(utility.Vector3dVector(base.v32), utility.Vector3iVector(base.t))
    mesh.vertex_colors = utility.Vector3dVector(base.c / 255)
    for name, words in [("o.ply", {}), ("oa.ply", dict(write_ascii=True)), ("o.obj", {}), ("o.stl", {}), ("o.glb", {})]:
        path = os.path.join(folder, name)
        mesh.compute_vertex_normals()
        io.write_triangle_mesh(path, mesh, **words)
        read = io.read_triangle_mesh(path)
        colours = np.asarray(read.vertex_colors) * 255
        if name.endswith(".glb"):  # Its own reader refuses it.
            read, colours = mesh, base.c
        yield path, indexed(read.vertices, read.triangles, colours if len(colours) else None, linear=name.endswith(".glb"))
    mesh.vertex_colors = utility.Vector3dVector()
    mesh.triangle_uvs = utility.Vector2dVector(base.uv[base.t].reshape(-1, 2))
    mesh.textures = [io.read_image(base.png).flip_vertical()]  # It holds images upside down.
    mesh.triangle_material_ids = utility.IntVector([0] * len(base.t))
    path = os.path.join(folder, "otex.obj")
    io.write_triangle_mesh(path, mesh)
    read = io.read_triangle_mesh(path, True)
    yield path, indexed(read.vertices, read.triangles, images=len(read.textures), drawn=True)


@writer
def pymeshlab(base, folder):
    import pymeshlab
    def held(path, **more):
        meshes = pymeshlab.MeshSet()
        meshes.load_new_mesh(path)
        mesh = meshes.current_mesh()
        colours = mesh.vertex_color_matrix() * 255 if mesh.has_vertex_color() else None
        return path, indexed(mesh.vertex_matrix(), mesh.face_matrix(), colours, **more)
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(base.ply)
    for name, words in [("m.ply", dict(save_vertex_quality=True)), ("ma.ply", dict(binary=False)), ("m.obj", {}), ("m.stl", {}), ("ma.stl", dict(binary=False))]:
        meshes.save_current_mesh(os.path.join(folder, name), **words)
        yield held(os.path.join(folder, name))
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(base.obj)
    for name in ["mtex.obj", "mtex.ply"]:
        meshes.save_current_mesh(os.path.join(folder, name))
        yield held(os.path.join(folder, name), images=1, drawn=True)
    mesh = pymeshlab.Mesh(base.v32.astype(float), face_list_of_indices=[list(q) for q in base.q])
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(mesh)
    meshes.save_current_mesh(os.path.join(folder, "mquads.obj"))
    path, wanted = held(os.path.join(folder, "mquads.obj"))
    yield path, dict(wanted, bent=True)


def vtk_soup(data):
    from vtk.util.numpy_support import vtk_to_numpy
    import vtk
    flat = vtk.vtkTriangleFilter()
    flat.SetInputData(data)
    flat.Update()
    data = flat.GetOutput()
    return vtk_to_numpy(data.GetPoints().GetData()), vtk_to_numpy(data.GetPolys().GetConnectivityArray()).reshape(-1, 3), data


@writer
def vtk(base, folder):
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy
    reader = vtk.vtkPLYReader()
    reader.SetFileName(base.ply)
    reader.Update()
    for name, write, read, kind in [("v.ply", vtk.vtkPLYWriter, vtk.vtkPLYReader, 2), ("va.ply", vtk.vtkPLYWriter, vtk.vtkPLYReader, 1),
                                    ("v.stl", vtk.vtkSTLWriter, vtk.vtkSTLReader, 2), ("va.stl", vtk.vtkSTLWriter, vtk.vtkSTLReader, 1),
                                    ("v.obj", vtk.vtkOBJWriter, vtk.vtkOBJReader, 0)]:
        path, writer = os.path.join(folder, name), write()
        writer.SetFileName(path)
        writer.SetInputConnection(reader.GetOutputPort())
        if kind:
            (writer.SetFileTypeToASCII if kind == 1 else writer.SetFileTypeToBinary)()
        if name.endswith("ply"):
            writer.SetArrayName("RGB")
        writer.Write()
        source = read()
        source.SetFileName(path)
        source.Update()
        points, triangles, data = vtk_soup(source.GetOutput())
        colours = data.GetPointData().GetArray("RGB")
        yield path, indexed(points, triangles, None if colours is None or not name.endswith("ply") else vtk_to_numpy(colours))


@writer
def pyvista(base, folder):
    import pyvista
    mesh = pyvista.PolyData(base.v32, np.c_[np.full(len(base.q), 4), base.q].ravel())
    for name in ["p.ply", "p.stl", "p.obj"]:
        path = os.path.join(folder, name)
        mesh.save(path)
        read = pyvista.read(path).triangulate()
        yield path, indexed(read.points, read.faces.reshape(-1, 4)[:, 1:])
    mesh.point_data["RGB"] = base.c
    mesh.save(os.path.join(folder, "prgb.ply"), texture="RGB")
    yield os.path.join(folder, "prgb.ply"), indexed(mesh.triangulate().points, mesh.triangulate().faces.reshape(-1, 4)[:, 1:], base.c)
    plotter = pyvista.Plotter(off_screen=True)
    plotter.add_mesh(mesh.triangulate(), scalars="RGB", rgb=True)
    plotter.export_gltf(os.path.join(folder, "p.gltf"))
    # The window of its plotter has z upwards: the export turns the mesh.
    yield os.path.join(folder, "p.gltf"), indexed(mesh.points[:, [1, 2, 0]], mesh.triangulate().faces.reshape(-1, 4)[:, 1:], base.c, linear=True)
    examples = os.path.join(os.path.dirname(pyvista.__file__), "examples")
    for path in sorted(glob.glob(examples + "/*.ply") + glob.glob(examples + "/*.stl")):
        if os.path.getsize(path) < 1 << 20:
            read = pyvista.read(path).triangulate()
            yield path, indexed(read.points, read.faces.reshape(-1, 4)[:, 1:], any_colour=True)


@writer
def meshio(base, folder):
    import meshio
    mesh = meshio.Mesh(base.v32.astype(float), [("triangle", base.t[:700]), ("quad", base.q[-100:])])
    for name, words in [("i.ply", {}), ("ia.ply", dict(binary=False)), ("i.obj", {})]:
        path = os.path.join(folder, name)
        mesh.write(path, **words)
        read = meshio.read(path)
        corners = [read.points[c.data][:, pick] for c in read.cells for pick in ([0, 1, 2], [0, 2, 3])[:c.data.shape[1] - 2]]
        yield path, facts(np.concatenate(corners))
    mesh = meshio.Mesh(base.v32, [("triangle", base.t)])
    for name, words in [("i.stl", dict(binary=True)), ("ia.stl", {})]:
        path = os.path.join(folder, name)
        mesh.write(path, **words)
        read = meshio.read(path)
        yield path, indexed(read.points, read.cells_dict["triangle"])


@writer
def numpy_stl(base, folder):
    from stl import Mode, mesh
    held = mesh.Mesh(np.zeros(len(base.t), dtype=mesh.Mesh.dtype))
    held.vectors[:] = base.v32[base.t]
    for name, mode in [("n.stl", Mode.BINARY), ("na.stl", Mode.ASCII)]:
        path = os.path.join(folder, name)
        held.save(path, mode=mode)
        yield path, facts(mesh.Mesh.from_file(path).vectors)


@writer
def plyfile(base, folder):
    from plyfile import PlyData, PlyElement
    rows = np.rec.fromarrays([*base.v.T, *(base.c / 255).astype(np.float32).T, *base.n.T], names="x,y,z,red,green,blue,nx,ny,nz")
    faces = np.empty(len(base.q), dtype=[("vertex_index", "O"), ("quality", "f4")])
    faces["vertex_index"], faces["quality"] = [q.astype(np.uint16) for q in base.q], 1
    for name, words in [("f.ply", dict(byte_order=">")), ("fa.ply", dict(text=True))]:
        path = os.path.join(folder, name)
        PlyData([PlyElement.describe(faces, "face", val_types={"vertex_index": "u2"}), PlyElement.describe(rows, "vertex")], **words).write(path)
        read = PlyData.read(path)
        quads = np.stack(read["face"]["vertex_index"])
        vertex = read["vertex"]
        yield path, indexed(np.stack([vertex[k] for k in "xyz"], 1), np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]),
                            np.stack([vertex[k] for k in ("red", "green", "blue")], 1) * 255, bent=True)


@writer
def gmsh(base, folder):
    import gmsh
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.model.occ.addTorus(1, 2, 3, 2, 0.6)
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMax", 0.4)
    gmsh.model.mesh.generate(2)
    tags, points, _ = gmsh.model.mesh.getNodes()
    at = np.zeros(int(tags.max()) + 1, int)
    at[tags.astype(int)] = np.arange(len(tags))
    triangles = at[gmsh.model.mesh.getElementsByType(2)[1].astype(int)]
    for name, binary in [("g.stl", 1), ("ga.stl", 0)]:
        gmsh.option.setNumber("Mesh.Binary", binary)
        path = os.path.join(folder, name)
        gmsh.write(path)
        yield path, indexed(points.reshape(-1, 3), triangles)
    gmsh.finalize()


@writer
def cadquery(base, folder):
    import cadquery
    part = cadquery.Workplane("XY").box(30, 20, 10).edges("|Z").fillet(3).faces(">Z").workplane().hole(8)
    for name, ascii in [("c.stl", False), ("ca.stl", True)]:
        path = os.path.join(folder, name)
        part.val().exportStl(path, 0.05, 0.2, ascii)
        points, triangles = part.val().tessellate(0.05, 0.2)
        points = np.array([p.toTuple() for p in points])
        yield path, indexed(points, triangles)
    assembly = cadquery.Assembly().add(part, color=cadquery.Color(1, 0.5, 0))
    assembly.add(part, loc=cadquery.Location((0, 0, 25), (0, 0, 1), 30))
    for name in ["c.glb", "c.gltf"]:
        path = os.path.join(folder, name)
        assembly.export(path, tolerance=0.05, angularTolerance=0.2)
        points = [np.array([q.toTuple() for q in s.tessellate(0.05, 0.2)[0]])[np.array(s.tessellate(0.05, 0.2)[1])]
                  for s in (part.val(), part.val().moved(cadquery.Location((0, 0, 25), (0, 0, 1), 30)))]
        corners = np.concatenate(points)[..., [0, 2, 1]] * [1, 1, -1]  # y upwards.
        yield path, facts(corners)


@writer
def Blender(base, folder):
    import bpy
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.obj_import(filepath=base.obj)
    thing = bpy.context.selected_objects[0]
    layer = thing.data.color_attributes.new("Col", "BYTE_COLOR", "POINT")
    for at, colour in enumerate(base.c):
        layer.data[at].color_srgb = (*(colour / 255), 1)

    def held(turn=True, colours=True, **more):
        corners, found = [], []
        for thing in bpy.context.scene.objects:
            if thing.type != "MESH":
                continue
            thing.data.calc_loop_triangles()
            points = np.array([thing.matrix_world @ v.co for v in thing.data.vertices])
            triangles = np.array([t.vertices for t in thing.data.loop_triangles])
            corners.append(points[triangles])
            if thing.data.color_attributes:
                found.append(np.array([d.color_srgb[:3] for d in thing.data.color_attributes[0].data])[triangles] * 255)
        corners = np.concatenate(corners)
        corners = corners[..., [0, 2, 1]] * [1, 1, -1] if turn else corners
        return facts(corners, np.concatenate(found) if colours and found else None, **more)

    export = bpy.ops.export_scene.gltf
    glb = dict(export_vertex_color="ACTIVE", export_all_vertex_colors=True)
    for name, write, more in [
            ("b.ply", lambda p: bpy.ops.wm.ply_export(filepath=p, export_colors="SRGB"), dict(turn=False)),
            ("ba.ply", lambda p: bpy.ops.wm.ply_export(filepath=p, ascii_format=True, export_colors="SRGB"), dict(turn=False)),
            ("b.stl", lambda p: bpy.ops.wm.stl_export(filepath=p), dict(turn=False, colours=False)),
            ("ba.stl", lambda p: bpy.ops.wm.stl_export(filepath=p, ascii_format=True), dict(turn=False, colours=False)),
            ("b.obj", lambda p: bpy.ops.wm.obj_export(filepath=p, path_mode="COPY", export_colors=True), dict(images=1, drawn=True)),
            ("b.glb", lambda p: export(filepath=p, export_format="GLB", **glb), dict(images=1, drawn=True)),
            ("bs.gltf", lambda p: export(filepath=p, export_format="GLTF_SEPARATE", **glb), dict(images=1, drawn=True)),
            ("bdraco.glb", lambda p: export(filepath=p, export_draco_mesh_compression_enable=True, **glb), dict(images=1, drawn=True, near=2e-3))]:
        path = os.path.join(folder, name)
        write(path)
        yield path, held(**more)
    for at in range(4):
        other = thing.copy()
        bpy.context.collection.objects.link(other)
        other.location, other.rotation_euler, other.scale = (3 * at, at, 5), (at, 0.4, 0), (1, 1 + at, -1)
    bpy.ops.mesh.primitive_cylinder_add(vertices=21, location=(0, 9, 0))
    bpy.context.view_layer.update()
    for name, write, more in [
            ("bscene.glb", lambda p: export(filepath=p, export_format="GLB", export_vertex_color="NONE"), dict(images=1)),
            ("binst.glb", lambda p: export(filepath=p, export_format="GLB", export_vertex_color="NONE", export_gpu_instances=True), dict(images=1)),
            ("bscene.obj", lambda p: bpy.ops.wm.obj_export(filepath=p, path_mode="RELATIVE"), dict(images=1))]:
        path = os.path.join(folder, name)
        write(path)
        yield path, held(colours=False, **more)


def shell(words, folder):
    subprocess.run(words, cwd=folder, check=True, capture_output=True)


def of_base(base, **more):
    return indexed(base.v32, base.t, **more)


@writer
def admesh(base, folder):
    numpy_path = os.path.join(folder, "adin.stl")
    import trimesh
    trimesh.Trimesh(base.v32, base.t, process=False).export(numpy_path)
    for name, option in [("ad.stl", "--write-binary-stl="), ("ada.stl", "--write-ascii-stl=")]:
        out = subprocess.run(["admesh", "--no-check", option + name, "adin.stl"], cwd=folder, check=True, capture_output=True, text=True).stdout
        n = next(int(line.split(":")[1].split()[0]) for line in out.splitlines() if line.startswith("Number of facets"))
        yield os.path.join(folder, name), dict(of_base(base), triangles=n)


@writer
def openctm_tools(base, folder):
    for name in ["ctm.ply", "ctm.stl", "ctm.obj"]:
        shell(["ctmconv", "base.ply", "ctm.ctm", "--method", "MG1"], folder)
        shell(["ctmconv", "ctm.ctm", name], folder)
        yield os.path.join(folder, name), of_base(base, colours=base.c if name.endswith("ply") else None)


@writer
def assimp_utils(base, folder):
    for kind in ["ply", "stl", "stlb", "obj", "glb2", "gltf2"]:  # Its own reader refuses its binary PLY, which is cut off.
        name = f"as{kind}." + {"ply": "ply", "stl": "stl", "stlb": "stl", "obj": "obj", "glb2": "glb", "gltf2": "gltf"}[kind]
        source = "base.ply" if kind.startswith(("ply", "stl")) else "base.obj"
        shell(["assimp", "export", source, name, "-f" + kind], folder)
        info = subprocess.run(["assimp", "info", name], cwd=folder, capture_output=True, text=True).stdout
        n = next(int(line.split(":")[1]) for line in info.splitlines() if line.startswith("Faces:"))
        textured = source.endswith("obj")
        yield os.path.join(folder, name), dict(of_base(base, colours=base.c if kind.startswith("ply") else None,
                                                       **(dict(images=1, drawn=True) if textured else {})), triangles=n)


@writer
def openscad(base, folder):
    with open(os.path.join(folder, "in.scad"), "w") as out:
        out.write("difference(){cube([20,10,6]);translate([10,5,-1])cylinder(h=8,r=3,$fn=40);}translate([30,0,0])rotate([20,0,0])sphere(4,$fn=24);")
    shell(["openscad", "-o", "scad.stl", "in.scad"], folder)
    shell(["openscad", "-o", "scad.off", "in.scad"], folder)
    import trimesh
    held = trimesh.load(os.path.join(folder, "scad.off"), process=False)
    yield os.path.join(folder, "scad.stl"), indexed(held.vertices, held.faces, near=1e-5)


@writer
def draco(base, folder):
    for source, back in [("base.ply", "dr.ply"), ("base.obj", "dr.obj")]:
        shell(["draco_encoder", "-i", source, "-o", "dr.drc", "-qp", "16"], folder)
        shell(["draco_decoder", "-i", "dr.drc", "-o", back], folder)
        yield os.path.join(folder, back), of_base(base, near=1e-3, colours=base.c if back.endswith("ply") else None)


@writer
def meshlab(base, folder):
    for name, mask in [("mlab.ply", "vc"), ("mlab.obj", "vc"), ("mlab.stl", "")]:
        shell(["xvfb-run", "-a", "meshlabserver", "-i", "base.ply", "-o", name] + (["-m", mask] if mask else []), folder)
        yield os.path.join(folder, name), of_base(base, colours=base.c if name.endswith(("ply", "obj")) else None)


@writer
def crates(base, folder):
    """Sample files of crates; what they hold is read by trimesh, or counted from the text."""
    import trimesh
    root = os.path.expanduser("~/.cargo/registry/src")
    names = ["stl_io-*/src/testdata/bunny_99*.stl", "ply-rs-bw-*/example_plys/*ok*.ply", "ply-rs-bw-*/example_plys/tetra*.ply",
             "ply-rs-bw-*/example_plys/diverse_field_formats/*.ply", "tobj-*/obj/*.obj", "obj-*/tests/**/*.obj"]
    for path in sorted(p for name in names for p in glob.glob(f"{root}/*/{name}", recursive=True)):
        try:
            mesh = trimesh.load(path, process=False, force="mesh")
            if len(mesh.faces):
                program = "crate " + path[len(root):].split("/")[2]
                yield path, indexed(mesh.vertices, mesh.faces, any_colour=True, program=program)
        except Exception:  # Points, or a file made to be refused.
            continue


def versions(name):
    distribution = {"numpy stl": "numpy-stl", "Blender": "bpy"}.get(name, name)
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        run = subprocess.run(["dpkg-query", "-W", "-f", "${Version}", name.replace(" ", "-")], capture_output=True, text=True)
        return run.stdout.split("-")[0].split("+")[0].split("~")[0] if run.returncode == 0 else ""


def picture(stonecut, path, folder):
    out = os.path.join(folder, "picture.png")
    subprocess.run([stonecut, "render", path, "-o", out, "--force", "--unlit", "--view", "front", "--size", "160x160"],
                   check=True, capture_output=True)
    from PIL import Image
    return np.asarray(Image.open(out).convert("RGB")).astype(float)


def found(stonecut, path, wanted, reference):
    """What stonecut reads from the file, as `facts`."""
    from plyfile import PlyData
    with tempfile.TemporaryDirectory() as folder:
        out = os.path.join(folder, "out.ply")
        run = subprocess.run([stonecut, "convert", path, out, "--keep-duplicates", "--format", "double,int", "--textures", "link", "-q"],
                             capture_output=True, text=True)
        if run.returncode not in (0, 3):
            return dict(refused=run.stderr.strip().splitlines()[-1][:200])
        info = json.loads(subprocess.run([stonecut, "info", "--json", path], capture_output=True, text=True, check=True).stdout)
        ply = PlyData.read(out)
        vertex, triangles = ply["vertex"], np.stack(ply["face"].data["vertex_indices"])
        colours = np.stack([vertex[k] for k in ("red", "green", "blue")], 1) if "red" in vertex.data.dtype.names else None
        if colours is not None and colours.dtype.kind == "f" and colours.max() <= 1:
            colours = colours * 255
        got = indexed(np.stack([vertex[k] for k in "xyz"], 1), triangles, colours, images=len(info.get("images", [])))
        if wanted.get("drawn"):
            got["drawn"] = float(np.abs(picture(stonecut, path, folder) - reference).mean())
        return got


def differences(wanted, got):
    if "refused" in got:
        return [got["refused"]]
    out, size = [], max(b - a for a, b in zip(*wanted["box"])) if "box" in wanted else 1
    near = wanted.get("near", 1e-5)
    if wanted["triangles"] != got["triangles"]:
        out.append(f"triangles {wanted['triangles']}")
    if "box" in wanted and np.abs(np.subtract(wanted["box"], got["box"])).max() > near * size:
        out.append(f"box {np.round(wanted['box'], 4).tolist()} {np.round(got['box'], 4).tolist()}")
    if "area" in wanted and abs(wanted["area"] / max(got["area"], 1e-30) - 1) > (5e-3 if wanted.get("bent") else max(10 * near, 1e-4)):
        out.append(f"area {wanted['area']:.6g}")
    if ("colour" in wanted) != ("colour" in got) and not (wanted.get("drawn") or wanted.get("any_colour")):
        out.append("colours" if "colour" in wanted else "colours of vertices that the program does not see")
    elif "colour" in wanted and np.abs(np.subtract(wanted["colour"], got["colour"])).max() > 1.5:
        out.append(f"colour {np.round(wanted['colour'], 1).tolist()}")
    if "images" in wanted and wanted["images"] != got["images"]:
        out.append(f"images {wanted['images']}")
    if got.get("drawn", 0) > 4:
        out.append(f"its picture is off by {got['drawn']:.1f} of 255")
    return out


def holds(wanted):
    """What a file holds, in a line."""
    out = f"{wanted['triangles']} triangles"
    if "box" in wanted:
        out += ", " + " x ".join(f"{b - a:.4g}" for a, b in zip(*wanted["box"]))
    if "area" in wanted:
        out += f", area {wanted['area']:.5g}"
    if "colour" in wanted:
        out += ", mean colour " + " ".join(f"{x:.0f}" for x in wanted["colour"])
    return out + (f", {wanted['images']} image" if wanted.get("images") else "") + (", its look" if wanted.get("drawn") else "")


def main():
    if sys.argv[1] == "write":
        base, folder = Base(sys.argv[3]), sys.argv[3]
        for path, wanted in WRITERS[sys.argv[2]](base, folder):
            if wanted.pop("linear", False) and wanted.pop("colour", None):
                wanted["any_colour"] = True  # The program takes sRGB for the linear light that glTF has, or the other way round.
            print("FACT " + json.dumps([path, wanted]), flush=True)
        return
    stonecut, folder = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    os.makedirs(folder, exist_ok=True)
    base = Base(folder)
    reference = picture(stonecut, base.obj, folder)
    rows, n_wrong, n = {}, 0, 0
    runs = [(f"{name} {versions(name)}", [sys.executable, os.path.abspath(__file__), "write", name, folder]) for name in WRITERS]
    if len(sys.argv) > 3:
        modules = os.path.abspath(sys.argv[3])
        runs += [(name, ["node", os.path.join(HERE, "written_by_others.mjs"), modules, folder, name]) for name in
                 ["three", "gltf-transform", "gltfpack", "obj2gltf", "babylonjs", "jscad"]]
    for name, words in runs:
        run = subprocess.run(words, capture_output=True, text=True, errors="replace", timeout=600, cwd=folder)
        lines = [line[5:] for line in run.stdout.splitlines() if line.startswith("FACT ")]
        for line in lines:
            path, wanted = json.loads(line)
            program = wanted.pop("program", name)
            got = found(stonecut, path, wanted, reference)
            wrong, n = differences(wanted, got), n + 1
            if wrong:
                n_wrong += 1
                print(f"{program}: {path}: {'; '.join(wrong)}; found {json.dumps(got)}", file=sys.stderr, flush=True)
            rows.setdefault((program, holds(wanted), "other" if wrong else "same"), []).append(os.path.basename(path))
        if run.returncode != 0:
            print(f"{name}: {'not installed' if 'No module named' in run.stderr else run.stderr.strip()[-300:]}", file=sys.stderr)
    print("| program | files | hold, by the program | stonecut |\n|---|---|---|---|")
    for (program, held, verdict), files in rows.items():
        print(f"| {program} | {', '.join(files)} | {held} | {verdict} |")
    print(f"\n{n} files of {len(set(program for program, *_ in rows))} programs, {n_wrong} read otherwise")
    sys.exit(n_wrong > 0)


if __name__ == "__main__":
    main()
