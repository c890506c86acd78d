#!/usr/bin/env python3
"""Sends complete files through every pair of formats and every command, and reads the results with other people's readers.

    python3 -m venv V; V/bin/pip install numpy-stl pillow plyfile pygltflib pymeshlab pywavefront
    STONECUT_KEPT=FOLDER cargo test --test formats kept_and_named     # writes the complete files into FOLDER
    V/bin/python tools/kept_by_others.py STONECUT FOLDER

Each kind of content that the readers find in the input is in the output, by the same readers, or in `losses` of the report. Where it is kept,
its values are compared: bounds, triangles, mean colours, range of texture coordinates, pixels of images, sets of labels. Prints a table row
for each command; what is lost in silence or has other values goes to standard error, with exit code 1.
"""

import io
import json
import logging
import os
import re
import shutil
import subprocess
import sys

import numpy as np
import plyfile
import pygltflib
import pymeshlab
import pywavefront
import stl
from PIL import Image

logging.disable(logging.CRITICAL)

# Kinds of loss, and words in them, that name a feature; the features' own names besides.
LEDGER = {
    "places": [("precision", "")], "normals": [("normals", "")], "opacity": [("colors", "opacity|colours of vertices")],
    "colours": [("colors", "colours of vertices|properties|not carried"), ("attributes", "red")],
    "coordinates": [("texture_coordinates", ""), ("images", "texture coordinates")], "second coordinates": [("texture_coordinates", ""), ("attributes", r"\(s, t\)")],
    "images": [("images", "")], "materials": [("materials", ""), ("images", "images")], "names": [("names", "names of objects|nodes")],
    "colours of faces": [("colors", "colours of faces|facets"), ("attributes", "red|colour")], "bytes of facets": [("attributes", "attribute bytes")], "comments": [("names", "comments")],
    "factors": [("colors", "material|colour"), ("materials", "")], "normal map": [("images", "normal map|images"), ("materials", "normal map")],
    "TANGENT": [("normals", "tangent")], "JOINTS_0": [("elements", "skins")], "WEIGHTS_0": [("elements", "skins")], "TEXCOORD_1": [("texture_coordinates", "")],
    "_QUALITY": [("attributes", "quality")], "targets": [("elements", "morph")], "mode 1": [("elements", "lines")], "cameras": [("elements", "cameras")],
    "skins": [("elements", "skins")], "animations": [("elements", "animations")], "KHR_materials_clearcoat": [("materials", "clearcoat")], "KHR_lights_punctual": [("elements", "lights")],
}


def pixels(paths_or_images):
    """Mean colours of the images that can be opened."""
    out = []
    for image in paths_or_images:
        try:
            out.append(np.asarray((image if isinstance(image, Image.Image) else Image.open(image)).convert("RGB"), float).mean((0, 1)).round(1).tolist())
        except OSError:
            pass
    return sorted(out)


def of_ply(path):
    data = plyfile.PlyData.read(path)
    vertex, face = data["vertex"], data["face"]
    corners = np.stack([vertex[a] for a in "xyz"], 1)
    names = {p.name: p for p in vertex.properties}
    out = {"bounds": bounds(corners), "triangles": sum(len(f) - 2 for f in face[face.properties[0].name])}
    if corners.dtype == float:
        out["places"] = True
    known = {"x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "alpha", "s", "t"}
    if "nx" in names:
        out["normals"] = True
    if "red" in names:
        out["colours"] = np.stack([vertex[c] for c in ("red", "green", "blue")], 1).mean(0)
    if "alpha" in names:
        out["opacity"] = float(vertex["alpha"].mean())
    of_faces = {p.name: p for p in face.properties[1:]}
    if "texcoord" in of_faces:
        out["coordinates"] = spread(np.concatenate(list(face["texcoord"])))
    if "s" in names:
        out["second coordinates" if "texcoord" in of_faces else "coordinates"] = spread(np.concatenate([vertex["s"], vertex["t"]]))
    if "red" in of_faces:
        out["colours of faces"] = True
    own = {"texcoord", "texnumber", "objectnumber", "red", "green", "blue"}
    out |= {n: sorted(set(map(str, vertex[n]))) if n == "class" else True for n in names if n not in known}
    out |= {n: sorted(set(map(str, face[n]))) if n == "part" else True for n in of_faces if n not in own}
    out |= {e.name: True for e in data.elements if e.name not in ("vertex", "face")}
    texts = data.comments + data.obj_info
    found = pixels(os.path.join(os.path.dirname(path), c.split(" ", 1)[1]) for c in texts if c.startswith("TextureFile"))
    out |= {"images": found} if found else {}
    if any(c.startswith("ObjectName") for c in texts):
        out["names"] = True
    if any(c.startswith("usemtl") for c in texts):
        out["materials"] = True
    if any("made by hand" in c for c in texts):
        out["comments"] = True
    return out


def of_obj(path):
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(path)
    # Parts of the file are joined, as MeshLab shows them.
    mesh = meshes.current_mesh()
    parts = pywavefront.Wavefront(path, collect_faces=True, create_materials=True)
    corners = np.array([v[:3] for v in parts.vertices])
    out = {"bounds": bounds(corners), "triangles": mesh.face_number()}
    if (np.float32(corners) != corners).any():
        out["places"] = True
    if any("N3F" in m.vertex_format for m in parts.materials.values()):
        out["normals"] = True
    if len(parts.vertices[0]) >= 6:
        out["colours"] = 255 * np.array([v[3:6] for v in parts.vertices]).mean(0)
    if mesh.has_wedge_tex_coord():
        out["coordinates"] = spread(mesh.wedge_tex_coord_matrix().reshape(-1))
    found = pixels(m.texture.path for m in parts.materials.values() if m.texture)
    out |= {"images": found} if found else {}
    named = [m for m in parts.materials.values() if not m.name.startswith("default")]
    if len(named) > 1:
        out["materials"] = True
    if any(0.99 > max(m.diffuse[:3]) or len(set(m.diffuse[:3])) > 1 for m in named):
        out["factors"] = True
    # The word that Blender and others write, which this reader does not have.
    library = path.replace(".obj", ".mtl")
    if os.path.exists(library) and re.search("(?m)^norm ", open(library).read()):
        out["normal map"] = True
    if len({m.name for m in parts.mesh_list if m.name}) > 1:
        out["names"] = True
    with open(path) as file:
        if "made by hand" in file.read(4000):
            out["comments"] = True
    return out


def of_stl(path):
    mesh = stl.mesh.Mesh.from_file(path)
    out = {"bounds": bounds(mesh.vectors.reshape(-1, 3)), "triangles": len(mesh), "normals": True}
    attributes = mesh.attr.reshape(-1)
    if attributes.any():
        out["colours of faces" if (attributes & 0x8000).any() else "bytes of facets"] = True
    with open(path, "rb") as file:
        if b"made by hand" in file.read(80):
            out["comments"] = True
    return out


def of_gltf(path):
    gltf = pygltflib.GLTF2().load(path)
    blob = gltf.binary_blob()
    if blob is None:
        with open(os.path.join(os.path.dirname(path), gltf.buffers[0].uri), "rb") as file:
            blob = file.read()

    def rows(number):
        accessor = gltf.accessors[number]
        view = gltf.bufferViews[accessor.bufferView]
        kind = np.dtype({5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}[accessor.componentType])
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[accessor.type]
        start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
        shape, strides = (accessor.count, width), (view.byteStride or width * kind.itemsize, kind.itemsize)
        values = np.ndarray(shape, kind, blob, start, strides).astype(float)
        return values / np.iinfo(kind).max if accessor.normalized else values

    out, places, colours, uv, n, names, looks, far = {}, [], [], [], 0, set(), set(), False
    open_nodes = [(node, np.eye(4)) for node in gltf.scenes[gltf.scene or 0].nodes]
    while open_nodes:
        number, outer = open_nodes.pop()
        node = gltf.nodes[number]
        assert node.rotation in (None, [0, 0, 0, 1]) and node.matrix is None
        own = np.diag([*(node.scale or [1, 1, 1]), 1.0])
        own[:3, 3] = node.translation or [0, 0, 0]
        far |= bool((np.float32(own[:3, 3]) != own[:3, 3]).any())
        open_nodes += [(child, outer @ own) for child in node.children or []]
        if node.mesh is None:
            continue
        names.add(node.name)
        for p in gltf.meshes[node.mesh].primitives:
            attributes = {k: v for k, v in vars(p.attributes).items() if v is not None}
            out |= {k: True for k in attributes if k not in ("POSITION", "NORMAL", "COLOR_0", "TEXCOORD_0")}
            out |= {"normals": True} if "NORMAL" in attributes else {}
            out |= {"targets": True} if p.targets else {}
            if p.mode not in (None, 4):
                out[f"mode {p.mode}"] = True
                continue
            places.append((np.c_[rows(p.attributes.POSITION), np.ones(gltf.accessors[p.attributes.POSITION].count)] @ (outer @ own).T)[:, :3])
            used = np.unique(rows(p.indices).astype(int))
            places[-1], n = places[-1][used], n + gltf.accessors[p.indices].count // 3
            colours += [rows(attributes["COLOR_0"])[used]] if "COLOR_0" in attributes else []
            uv += [rows(attributes["TEXCOORD_0"])[used]] if "TEXCOORD_0" in attributes else []
            looks |= {p.material} - {None}
    out |= {"bounds": bounds(np.concatenate(places)), "triangles": n}
    if far:
        out["places"] = True
    if colours:
        light = np.concatenate(colours)
        out["colours"] = 255 * np.where(light[:, :3] <= 0.0031308, 12.92 * light[:, :3], 1.055 * light[:, :3] ** (1 / 2.4) - 0.055).mean(0)
        if light.shape[1] > 3 and light[:, 3].min() < 0.99:
            out["opacity"] = float(255 * light[:, 3].mean())
    if uv:
        out["coordinates"] = spread(np.concatenate(uv).reshape(-1))
    looks = [gltf.materials[k] for k in looks]
    base = [m.pbrMetallicRoughness.baseColorTexture for m in looks if m.pbrMetallicRoughness]
    images = [gltf.images[gltf.textures[t.index].source] for t in base if t]
    found = []
    for image in images:
        if image.uri:
            found.append(os.path.join(os.path.dirname(path), image.uri))
        else:
            view = gltf.bufferViews[image.bufferView]
            found.append(Image.open(io.BytesIO(blob[view.byteOffset or 0:][:view.byteLength])))
    found = pixels(found)
    out |= {"images": found} if found else {}
    out |= {"materials": True} if len(looks) > 1 else {}
    if any(m.pbrMetallicRoughness and m.pbrMetallicRoughness.baseColorFactor not in (None, [1.0, 1.0, 1.0, 1.0]) for m in looks):
        out["factors"] = True
    if any(m.normalTexture for m in looks):
        out["normal map"] = True
    if len(names - {None}) > 1:
        out["names"] = True
    out |= {e: True for m in looks for e in m.extensions or {} if e == "KHR_materials_clearcoat"}
    out |= {k: True for k in ("cameras", "skins", "animations") if getattr(gltf, k)}
    if "KHR_lights_punctual" in (gltf.extensionsUsed or []):
        out["KHR_lights_punctual"] = True
    if "made by hand" in f"{gltf.asset.copyright} {gltf.asset.extras}":
        out["comments"] = True
    return out


def bounds(points):
    points = np.asarray(points, float)
    return np.concatenate([points.min(0), points.max(0)])


def spread(values):
    return [float(np.min(values)), float(np.max(values))]


def read(path):
    return {"ply": of_ply, "obj": of_obj, "stl": of_stl, "glb": of_gltf, "gltf": of_gltf}[path.rsplit(".", 1)[1]](path)


COMMANDS = [("convert", "convert IN OUT"), ("convert --weld 1e-9", "convert IN OUT --weld 1e-9"), ("simplify", "simplify IN OUT --ratio 50% --texture keep"),
            ("bake", "simplify IN OUT --ratio 50% --texture bake --bake-size 64 --normals recompute"),
            ("cluster", "simplify IN OUT --method cluster --ratio 50% --drop-texture"), ("decimate", "simplify IN OUT --method decimate --ratio 50% --drop-texture"),
            ("retile", "simplify IN OUT --method retile --ratio 50% --drop-texture"), ("optimize", "simplify IN OUT --ratio 50% --optimize 1 --drop-texture"),
            ("pairs", "simplify IN OUT --ratio 50% --pairs --drop-texture"), ("max-error", "simplify IN OUT --max-error 0.05"),
            ("extract", "tiles IN T --force && extract T OUT --max-error 0"), ("refine", "simplify IN X.ply --ratio 50% --drop-texture --drop-faces --progressive P.scp && refine P.scp OUT --triangles 100")]


def losses_of(stonecut, folder, command):
    """Runs the parts of a command; all losses together, the code of the last, and what was said."""
    losses, said = [], ""
    for part in command.split(" && "):
        report = os.path.join(folder, "r.json")
        if os.path.exists(report):
            os.remove(report)
        words = part.split() + ["--progress", "json"]
        words += ["--force"] if "--force" not in words else []
        done = subprocess.run([stonecut, *words], cwd=folder, capture_output=True, text=True, timeout=300)
        said += done.stderr
        for line in done.stderr.splitlines():
            try:
                loss = json.loads(line).get("loss")
            except ValueError:
                continue
            losses += [loss] if loss else []
        if done.returncode not in (0, 3):
            return None, done.returncode, said
    return losses, done.returncode, said


def main():
    stonecut, folder = os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2])
    bad, table, n_checks = [], [], 0
    inputs = ["full.ply", "full.obj", "colours.stl", "bytes.stl", "full.gltf"]
    held = {name: read(os.path.join(folder, name)) for name in inputs}
    # Those of facets say nothing that the triangles do not.
    for name in inputs:
        if name.endswith(".stl"):
            del held[name]["normals"]
    for title, command in COMMANDS:
        row = dict(kept=0, named=0, refused=0)
        for name in inputs:
            for ending in ("ply", "obj", "stl", "glb"):
                out = os.path.join(folder, "out")
                shutil.rmtree(out, ignore_errors=True)
                os.mkdir(out)
                words = command.replace("IN", name).replace("OUT", f"out/o.{ending}").replace("T ", "out/t ").replace("X.ply", "out/x.ply").replace("P.scp", "out/p.scp")
                losses, code, said = losses_of(stonecut, folder, words)
                where = f"{name}: {words}"
                if losses is None:
                    row["refused"] += 1
                    # What cannot be done is said, with what helps.
                    if code not in (2, 4, 8) or not re.search("--drop|choose|give |write |has neither", said):
                        bad.append(f"{where}: exit code {code}\n{said[-400:]}")
                    continue
                if not os.path.exists(os.path.join(out, f"o.{ending}")):
                    # A bound on the error that rounding breaks has no result.
                    row["refused"] += 1
                    if code != 3 or "precision" not in said:
                        bad.append(f"{where}: exit code {code} without a file\n{said[-400:]}")
                    continue
                now, was = read(os.path.join(out, f"o.{ending}")), held[name]
                given_up = ("images", "coordinates", "materials", "factors", "normal map", "second coordinates", "TEXCOORD_1", "KHR_materials_clearcoat")
                for kind in was:
                    if "--drop-texture" in words and kind in given_up or "--drop-faces" in words and kind in ("names", "colours of faces"):
                        continue
                    n_checks += 1
                    texts = [(loss["kind"], f"{loss['what']} {loss['example']} {loss['reason']}".lower()) for loss in losses]
                    named = any(k == of and re.search(pattern or ".", text) for of, pattern in LEDGER.get(kind, []) for k, text in texts)
                    named |= any(re.search(rf"\b{re.escape(kind.lower())}\b", text) for _, text in texts)
                    if kind not in now and not named:
                        bad.append(f"{where}: {kind} is lost in silence")
                    elif kind not in now:
                        row["named"] += 1
                    else:
                        row["kept"] += 1
                        what = differs(kind, was[kind], now[kind], title, was)
                        if what and not named:
                            bad.append(f"{where}: {kind}: {what}")
        table.append(f"| {title} | {row['kept']} | {row['named']} | {row['refused']} |")
    print("| command | kept | named | refused |\n|---|---|---|---|")
    print("\n".join(table))
    print(f"{n_checks} kinds of content looked for, {len(bad)} lost in silence or with other values", file=sys.stderr)
    print("\n".join(bad), file=sys.stderr)
    sys.exit(1 if bad else 0)


def differs(kind, was, now, title, all_was):
    """A word on the difference of values, if there is one that is more than the command may make."""
    exact = title.startswith("convert")
    size = np.ptp(all_was["bounds"].reshape(2, 3), axis=0).max()
    if kind == "bounds":
        far = np.abs(was).max() > 1e5
        limit = (1e-4 if exact else 0.15) * size + (0.5 if far else 0)
        return "" if np.abs(was - now).max() <= limit else f"{was} became {now}"
    if kind == "triangles":
        return "" if now == was or not exact and now < was or title in ("extract",) else f"{was} became {now}"
    if kind in ("colours", "opacity") and now is not None:
        apart = np.abs(np.asarray(was) - np.asarray(now)).max()
        return "" if apart <= (2 if exact else 25) else f"{was} became {now}"
    if kind == "coordinates":
        return "" if title == "bake" or np.abs(np.asarray(was) - np.asarray(now)).max() <= (2e-3 if exact else 0.1) else f"{was} became {now}"
    if kind == "images":
        return "" if title == "bake" or sorted(was) == sorted(now) else f"{was} became {now}"
    if kind in ("class", "part"):
        return "" if set(now) <= set(was) else f"{was} became {now}"
    return ""


if __name__ == "__main__":
    main()
