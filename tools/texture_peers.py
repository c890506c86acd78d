#!/usr/bin/env python3
"""Makes charts for the results of `stonecut simplify --texture bake`, and fills their page, by other programs.

usage: texture_peers.py xatlas RESULT.obj OUT.obj SIDE GAP          charts by xatlas
       texture_peers.py smart RESULT.obj OUT.obj SIDE GAP           charts by Blender's smart projection
       texture_peers.py packed RESULT.obj OUT.obj SIDE GAP          these, packed by outlines (`pack_islands`, CONCAVE)
       texture_peers.py blender ORIGINAL RESULT.obj FOLDER REACH    Cycles, selected to active, colour, one sample (GLB)
       texture_peers.py pymeshlab ORIGINAL RESULT.obj FOLDER REACH  `transfer_attributes_to_texture_per_vertex` (OBJ, PNG)
needs numpy, pillow, charts.py beside it, and xatlas, bpy or pymeshlab (PyPI). SIDE of the page and GAP between charts
are in texels; `charts.py` measures OUT. The page of RESULT is the only one (`--bake-pages 1`); FOLDER gets the same
triangles and coordinates with the other page (PNG), for `stonecut measure --appearance`. REACH is how far from the
result the original is looked for, in units of the input. Processor seconds are those of charts and packing, or of the
transfer alone and of the whole script.
"""
import os
import shutil
import sys
import time
import numpy as np
from PIL import Image
from charts import numbered, read


def by_xatlas(points, faces, side, space):
    import xatlas
    resolution = side
    for _ in range(4):  # It meets the side that is asked for only roughly; the last one is timed.
        atlas, options = xatlas.Atlas(), xatlas.PackOptions()
        atlas.add_mesh(points.astype("f4"), faces.astype("u4"))
        options.resolution, options.padding, options.bilinear = int(resolution), space // 2, False
        begin = time.process_time()
        atlas.generate(pack_options=options)
        seconds = time.process_time() - begin
        resolution *= side / max(atlas.width, atlas.height)
    assert atlas.atlas_count == 1, "more than one page"
    _, corner, uv = atlas.get_mesh(0)
    return uv[corner], (atlas.width, atlas.height), seconds


def by_blender(points, faces, side, space, again):
    import bpy
    mesh = bpy.data.meshes.new("m")
    mesh.from_pydata((points / np.ptp(points) * 100).tolist(), [], faces.tolist())
    body = bpy.data.objects.new("m", mesh)
    bpy.context.collection.objects.link(body)
    bpy.context.view_layer.objects.active = body
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    margin = {"margin_method": "FRACTION", "margin" if again else "island_margin": space / 2 / side}
    begin = time.process_time()
    bpy.ops.uv.smart_project(**({} if again else margin))
    if again:
        bpy.ops.uv.select_all(action="SELECT")
        bpy.ops.uv.pack_islands(shape_method="CONCAVE", **margin)
    seconds = time.process_time() - begin
    bpy.ops.object.mode_set(mode="OBJECT")
    uv = np.empty(len(faces) * 6, "f4")
    mesh.uv_layers.active.data.foreach_get("uv", uv)
    return uv.reshape(-1, 3, 2), (side, side), seconds


def make(program, source, target, side, space):
    """Writes the triangles of `source` with other charts."""
    p = read(source)[0]
    place, first, _ = numbered(p)
    rest = p.reshape(-1, 3)[first], place, int(side), int(space)
    uv, size, seconds = by_xatlas(*rest) if program == "xatlas" else by_blender(*rest, program == "packed")
    with open(target, "w") as file:
        file.write("# page %d %d\n" % tuple(size))
        file.writelines("v %.9g %.9g %.9g\n" % tuple(x) for x in rest[0])
        file.writelines("vt %.9g %.9g\n" % tuple(x) for x in uv.reshape(-1, 2))
        file.writelines("f %d/%d %d/%d %d/%d\n" % (a, 3 * i + 1, b, 3 * i + 2, c, 3 * i + 3)
                        for i, (a, b, c) in enumerate(place + 1))
    print(f"{target}: {seconds:.2f} processor seconds", flush=True)


def library(result):
    """Path of the material library and of the only image in it."""
    folder = os.path.dirname(result)
    words = dict(l.split(None, 1) for l in open(result[:-4] + ".mtl") if " " in l)
    return result[:-4] + ".mtl", os.path.join(folder, words["map_Kd"].strip())


def blender(original, result, page, size, reach):
    import bpy
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=original)
    sources = [o for o in bpy.context.scene.objects if o.type == "MESH"]
    bpy.ops.wm.obj_import(filepath=result, forward_axis="NEGATIVE_Z", up_axis="Y")
    target = [o for o in bpy.context.scene.objects if o.type == "MESH" and o not in sources][0]
    image = bpy.data.images.new("page", *size)
    for slot in target.material_slots:
        nodes = slot.material.node_tree.nodes
        nodes.active = nodes.new("ShaderNodeTexImage")
        nodes.active.image = image
    for other in bpy.context.scene.objects:
        other.select_set(other in sources or other is target)
    bpy.context.view_layer.objects.active = target
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.cycles.device = "CYCLES", 1, "CPU"
    bake = scene.render.bake
    bake.use_pass_direct = bake.use_pass_indirect = False
    bake.use_pass_color = True
    begin = time.process_time()
    bpy.ops.object.bake(type="DIFFUSE", pass_filter={"COLOR"}, use_selected_to_active=True, margin=12,
                        cage_extrusion=reach, max_ray_distance=2 * reach)
    seconds = time.process_time() - begin
    image.filepath_raw, image.file_format = page, "PNG"
    image.save()
    return seconds


def pymeshlab(original, result, page, size, reach):
    import pymeshlab
    scene = pymeshlab.MeshSet()
    scene.load_new_mesh(original)
    source = scene.current_mesh_id()
    scene.load_new_mesh(result)
    begin = time.process_time()
    scene.transfer_attributes_to_texture_per_vertex(
        sourcemesh=source, targetmesh=scene.current_mesh_id(), attributeenum="Texture Color",
        upperbound=pymeshlab.PureValue(reach), textname=os.path.basename(page), textw=size[0], texth=size[1],
        overwrite=False, pullpush=True)
    seconds = time.process_time() - begin
    scene.save_current_mesh(os.path.join(os.path.dirname(page), "saved.obj"))
    return seconds


def fill(program, original, result, folder, reach):
    os.makedirs(folder, exist_ok=True)
    materials, image = library(result)
    page = os.path.join(os.path.abspath(folder), "page.png")
    size = Image.open(image).size
    seconds = globals()[program](original, result, page, size, float(reach))
    shutil.copy(result, folder)
    with open(os.path.join(folder, os.path.basename(materials)), "w") as file:
        for line in open(materials):
            file.write("map_Kd page.png\n" if line.startswith("map_Kd") else line)
    print(f"{program}: {seconds:.1f} processor seconds, {time.process_time():.1f} with files and start, "
          f"a page of {size[0]} x {size[1]}")


if __name__ == "__main__":
    if len(sys.argv) == 6 and sys.argv[1] in ("xatlas", "smart", "packed"):
        make(*sys.argv[1:])
    elif len(sys.argv) == 6 and sys.argv[1] in ("blender", "pymeshlab"):
        fill(*sys.argv[1:])
    else:
        sys.exit(__doc__)
