// The writers of npm packages for written_by_others.py: node written_by_others.mjs NODE_MODULES FOLDER PROGRAM
import { createRequire } from 'module';
import { execFileSync } from 'child_process';
import { pathToFileURL } from 'url';
import fs from 'fs';
import path from 'path';

const [modules, folder, program] = process.argv.slice(2);
const require = createRequire(path.join(path.resolve(modules), 'x.js'));
const load = (name) => import(pathToFileURL(require.resolve(name)));
const file = (name) => import(pathToFileURL(path.join(path.resolve(modules), name)));
const at = (name) => path.join(folder, name);
const version = (name) => JSON.parse(fs.readFileSync(path.join(modules, name, 'package.json'))).version;
const base = JSON.parse(fs.readFileSync(at('base.json')));
const png = fs.readFileSync(at('base.png'));
const flat = (rows, type) => type.from(rows.flat());
const indices = () => flat(base.t, Uint16Array);

function fact(name, words, wanted) {
  console.log('FACT ' + JSON.stringify([at(name), { program: words, ...wanted }]));
}

/// Triangles, box and area of corners, nine numbers a triangle.
function facts(corners, more = {}) {
  const box = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  let area = 0;
  for (let i = 0; i < corners.length; i += 9) {
    const p = corners.slice(i, i + 9), [a, b] = [[], []];
    for (let k = 0; k < 3; k++) {
      for (let c = 0; c < 3; c++) {
        box[0][k] = Math.min(box[0][k], p[3 * c + k]);
        box[1][k] = Math.max(box[1][k], p[3 * c + k]);
      }
      a.push(p[3 + k] - p[k]);
      b.push(p[6 + k] - p[k]);
    }
    area += Math.hypot(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]) / 2;
  }
  return { triangles: corners.length / 9, box, area, ...more };
}

const apply = (m, p) => [0, 1, 2].map((r) => m[r] * p[0] + m[4 + r] * p[1] + m[8 + r] * p[2] + m[12 + r]);
/// A matrix, column by column, of a shift, a quaternion and a scale.
function matrix(shift, [x, y, z, w], scale) {
  const turn = [[1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)], [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
    [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)]];
  return [...turn.flatMap((column, k) => [...column.map((value) => value * scale[k]), 0]), ...shift, 1];
}

const light = (srgb) => (srgb / 255 <= 0.04045 ? srgb / 255 / 12.92 : ((srgb / 255 + 0.055) / 1.055) ** 2.4);
const srgb = (x) => 255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);

async function transformer() {
  const { NodeIO } = await load('@gltf-transform/core');
  const { ALL_EXTENSIONS } = await load('@gltf-transform/extensions');
  const draco3d = (await load('draco3dgltf')).default;
  const { MeshoptDecoder, MeshoptEncoder } = await load('meshoptimizer');
  await MeshoptDecoder.ready;
  await MeshoptEncoder.ready;
  return new NodeIO().registerExtensions(ALL_EXTENSIONS).registerDependencies({
    'draco3d.decoder': await draco3d.createDecoderModule(), 'draco3d.encoder': await draco3d.createEncoderModule(),
    'meshopt.decoder': MeshoptDecoder, 'meshopt.encoder': MeshoptEncoder,
  });
}

/// What glTF Transform reads from a file: triangles in the world, colours, images.
async function held(io, name, more = {}) {
  const document = await io.read(at(name)), corners = [], colours = [];
  for (const node of document.getRoot().listNodes()) {
    if (!node.getMesh()) continue;
    const instances = node.getExtension('EXT_mesh_gpu_instancing');
    const count = instances ? instances.getAttribute('TRANSLATION').getCount() : 1;
    for (let i = 0; i < count; i++) {
      const of = (name, usual) => instances?.getAttribute(name)?.getElement(i, []) ?? usual;
      const move = apply.bind(null, matrix(of('TRANSLATION', [0, 0, 0]), of('ROTATION', [0, 0, 0, 1]), of('SCALE', [1, 1, 1])));
      for (const primitive of node.getMesh().listPrimitives()) {
        const positions = primitive.getAttribute('POSITION'), colour = primitive.getAttribute('COLOR_0'), list = primitive.getIndices();
        for (let k = 0; k < (list ?? positions).getCount(); k++) {
          const v = list ? list.getScalar(k) : k;
          corners.push(...apply(node.getWorldMatrix(), move(positions.getElement(v, []))));
          if (colour) colours.push(colour.getElement(v, []).slice(0, 3).map(srgb));
        }
      }
    }
  }
  const out = facts(corners, { images: document.getRoot().listTextures().length, ...more });
  if (colours.length) out.colour = [0, 1, 2].map((c) => colours.reduce((sum, x) => sum + x[c], 0) / colours.length);
  return out;
}

const programs = {
  async three() {
    const THREE = await file('three/build/three.module.js');
    globalThis.FileReader = class {
      readAsArrayBuffer(blob) { blob.arrayBuffer().then((result) => { this.result = result; this.onloadend(); }); }
      readAsDataURL(blob) {
        blob.arrayBuffer().then((x) => { this.result = 'data:application/octet-stream;base64,' + Buffer.from(x).toString('base64'); this.onloadend(); });
      }
    };
    const example = (name) => file(`three/examples/jsm/${name}.js`);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(flat(base.v, Float32Array), 3));
    geometry.setAttribute('normal', new THREE.BufferAttribute(flat(base.n, Float32Array), 3));
    geometry.setAttribute('uv', new THREE.BufferAttribute(flat(base.uv, Float32Array), 2));
    geometry.setAttribute('color', new THREE.BufferAttribute(Float32Array.from(base.c.flat(), light), 3));
    geometry.setIndex(new THREE.BufferAttribute(indices(), 1));
    const mesh = new THREE.Mesh(geometry, new THREE.MeshStandardMaterial({ vertexColors: true }));
    const words = `three ${version('three')}`;
    const of = (mesh, more) => {
      const corners = [], list = mesh.geometry.toNonIndexed().getAttribute('position');
      mesh.updateWorldMatrix(true, false);
      for (let i = 0; i < list.count; i++) corners.push(...new THREE.Vector3().fromBufferAttribute(list, i).applyMatrix4(mesh.matrixWorld));
      return facts(corners, more);
    };
    const colour = [0, 1, 2].map((c) => base.t.flat().reduce((sum, v) => sum + base.c[v][c], 0) / base.t.flat().length);
    const { PLYExporter } = await example('exporters/PLYExporter'), { PLYLoader } = await example('loaders/PLYLoader');
    for (const [name, options] of [['three.ply', { binary: true, littleEndian: true }], ['threeb.ply', { binary: true }], ['threea.ply', {}]]) {
      const out = new PLYExporter().parse(mesh, null, options);
      fs.writeFileSync(at(name), typeof out === 'string' ? out : Buffer.from(out));
      const data = fs.readFileSync(at(name));
      const read = new PLYLoader().parse(data.buffer.slice(data.byteOffset, data.byteOffset + data.length));
      fact(name, words, of(new THREE.Mesh(read), { colour }));
    }
    const { STLExporter } = await example('exporters/STLExporter'), { STLLoader } = await example('loaders/STLLoader');
    mesh.position.set(1, 2, 3);
    mesh.rotation.set(0.3, 0.4, 0.5);
    mesh.updateMatrixWorld();
    for (const [name, binary] of [['three.stl', true], ['threea.stl', false]]) {
      const out = new STLExporter().parse(mesh, { binary });
      fs.writeFileSync(at(name), typeof out === 'string' ? out : Buffer.from(out.buffer));
      const data = fs.readFileSync(at(name));
      fact(name, words, of(new THREE.Mesh(new STLLoader().parse(data.buffer.slice(data.byteOffset, data.byteOffset + data.length)))));
    }
    const { OBJExporter } = await example('exporters/OBJExporter'), { OBJLoader } = await example('loaders/OBJLoader');
    fs.writeFileSync(at('three.obj'), new OBJExporter().parse(mesh));
    fact('three.obj', words, of(new OBJLoader().parse(fs.readFileSync(at('three.obj'), 'utf8')).children[0], { colour }));
    const { GLTFExporter } = await example('exporters/GLTFExporter');
    const scene = new THREE.Scene(), group = new THREE.Group();
    group.scale.set(2, 1, -1);
    scene.add(group.add(mesh));
    scene.updateMatrixWorld(true);
    fs.writeFileSync(at('three.glb'), Buffer.from(await new GLTFExporter().parseAsync(scene, { binary: true })));
    fact('three.glb', words, of(mesh, { colour }));
  },

  async 'gltf-transform'() {
    const io = await transformer(), words = `gltf-transform ${version('@gltf-transform/core')}`;
    const { Document } = await load('@gltf-transform/core');
    const { KHRTextureTransform, EXTMeshGPUInstancing, KHRTextureBasisu } = await load('@gltf-transform/extensions');
    const functions = await load('@gltf-transform/functions');
    const { MeshoptEncoder } = await load('meshoptimizer');
    const make = (coloured = true) => {
      const document = new Document(), buffer = document.createBuffer();
      const accessor = (type, array) => document.createAccessor().setType(type).setArray(array).setBuffer(buffer);
      const material = document.createMaterial('skin').setRoughnessFactor(1).setBaseColorTexture(
        document.createTexture('base').setImage(new Uint8Array(png)).setMimeType('image/png'));
      const primitive = document.createPrimitive().setMaterial(material).setIndices(accessor('SCALAR', indices()))
        .setAttribute('POSITION', accessor('VEC3', flat(base.v, Float32Array)))
        .setAttribute('NORMAL', accessor('VEC3', flat(base.n, Float32Array)))
        .setAttribute('TEXCOORD_0', accessor('VEC2', Float32Array.from(base.uv.flatMap(([u, v]) => [u, 1 - v]))));
      if (coloured) primitive.setAttribute('COLOR_0', accessor('VEC4', Uint16Array.from(base.c.flatMap((c) => [...c.map((x) => 65535 * light(x)), 65535]))).setNormalized(true));
      const node = document.createNode('ball').setMesh(document.createMesh('ball').addPrimitive(primitive));
      document.createScene().addChild(node);
      return { document, node, material, accessor, primitive };
    };
    const write = async (name, made, more) => {
      await io.write(at(name), made.document);
      fact(name, words, await held(io, name, more));
    };
    await write('gt.glb', make(), {});
    const draw = { drawn: true };
    const plain = (change) => { const made = make(false); change?.(made); return made; };
    await write('gtskin.gltf', plain(), draw);
    for (const [name, transforms, near] of [
      ['gtdraco.glb', [functions.draco()], 1e-3],
      ['gtdracoseq.glb', [functions.draco({ method: 'sequential', quantizePosition: 16 })], 1e-3],
      ['gtquant.glb', [functions.quantize({ quantizePosition: 14 })], 1e-3],
      ['gtmeshopt.glb', [functions.reorder({ encoder: MeshoptEncoder }), functions.meshopt({ encoder: MeshoptEncoder, level: 'medium' })], 1e-3],
      ['gtmeshopthigh.glb', [functions.meshopt({ encoder: MeshoptEncoder, level: 'high' })], 1e-3],
      ['gtsparse.glb', [functions.sparse({ ratio: 1 })], 1e-5],
      ['gtunwelded.glb', [functions.unweld()], 1e-5],
    ]) {
      const made = plain();
      await made.document.transform(...transforms);
      await write(name, made, { near, ...draw });
    }
    const instanced = plain(({ document, node, accessor }) => {
      const batch = document.createExtension(EXTMeshGPUInstancing).setRequired(true).createInstancedMesh();
      node.setExtension('EXT_mesh_gpu_instancing', batch.setAttribute('TRANSLATION', accessor('VEC3', new Float32Array([0, 0, 0, 5, 0, 0, 0, 5, 1]))));
      node.setRotation([0, 0.6, 0, 0.8]).setScale([1, 2, 1]);
    });
    await write('gtinstances.glb', instanced, {});
    // The image is a quarter of itself, shrunk and moved back by the transform: it looks as before.
    const moved = plain(({ document, material, primitive }) => {
      const coordinates = primitive.getAttribute('TEXCOORD_0');
      coordinates.setArray(coordinates.getArray().map((x, k) => (x - [0.25, 0.5][k % 2]) / [2, 4][k % 2]));
      material.getBaseColorTextureInfo().setExtension('KHR_texture_transform',
        document.createExtension(KHRTextureTransform).setRequired(true).createTransform().setOffset([0.25, 0.5]).setScale([2, 4]));
    });
    await write('gttransform.glb', moved, draw);
    const sharp = (await load('sharp')).default;
    for (const [name, kind] of [['gtjpeg.glb', 'jpeg'], ['gtwebp.glb', 'webp']]) {
      const made = plain();
      await made.document.transform(functions.textureCompress({ encoder: sharp, targetFormat: kind }));
      await write(name, made, draw);
    }
    const { encodeToKTX2 } = await file('ktx2-encoder/dist/node/index.js');
    const imageDecoder = async (bytes) => {
      const { data, info } = await sharp(bytes).ensureAlpha().raw().toBuffer({ resolveWithObject: true });
      return { data: new Uint8Array(data), width: info.width, height: info.height };
    };
    for (const [name, isUASTC, generateMipmap] of [['gtuastc.glb', true, true], ['gtetc1s.glb', false, true], ['gtuastcplain.glb', true, false]]) {
      const made = plain();
      const log = console.log;
      console.log = () => {};
      const image = await encodeToKTX2(new Uint8Array(png), { isUASTC, generateMipmap, imageDecoder });
      console.log = log;
      made.document.createExtension(KHRTextureBasisu).setRequired(true);
      made.document.getRoot().listTextures()[0].setImage(image).setMimeType('image/ktx2');
      await write(name, made, draw);
    }
  },

  async gltfpack() {
    const io = await transformer(), words = `gltfpack ${version('gltfpack')}`;
    const source = fs.existsSync(at('gtskin.gltf')) ? 'gtskin.gltf' : 'base.obj';
    for (const [name, options] of [['pack.glb', []], ['packc.glb', ['-c']], ['packcc.glb', ['-cc']], ['packcz.glb', ['-cz']], ['packkhr.glb', ['-cc', '-ce', 'khr']], ['packczkhr.glb', ['-cz', '-ce', 'khr', '-vpn']],
      ['packcf.glb', ['-c', '-cf']], ['packvi.glb', ['-c', '-vi', '-vp', '16']], ['packnoq.glb', ['-noq']], ['packobj.glb', ['-cc', '-vpf'], 'base.obj'],
      ['packmi.glb', ['-mi'], 'gtinstances.glb']]) {
      const from = name === 'packobj.glb' ? 'base.obj' : name === 'packmi.glb' ? 'gtinstances.glb' : source;
      execFileSync('node', [path.join(modules, 'gltfpack/cli.js'), '-i', from, '-o', name, ...options], { cwd: folder, stdio: 'pipe' });
      // glTF Transform has no KHR_meshopt_compression: the same mesh, not compressed.
      fact(name, words, await held(io, /cz|khr/.test(name) ? 'pack.glb' : name, { near: 1e-3, ...(name === 'packmi.glb' ? {} : { drawn: true }) }));
    }
  },

  async obj2gltf() {
    const io = await transformer(), words = `obj2gltf ${version('obj2gltf')}`;
    const obj2gltf = (await load('obj2gltf')).default;
    fs.writeFileSync(at('o2g.glb'), await obj2gltf(at('base.obj'), { binary: true }));
    fact('o2g.glb', words, await held(io, 'o2g.glb', { drawn: true }));
    fs.writeFileSync(at('o2g.gltf'), JSON.stringify(await obj2gltf(at('base.obj'), { unlit: true })));
    fact('o2g.gltf', words, await held(io, 'o2g.gltf', { drawn: true }));
  },

  async babylonjs() {
    globalThis.XMLHttpRequest = class {};
    const BABYLON = require('babylonjs');
    globalThis.BABYLON = BABYLON;
    const serializers = require('babylonjs-serializers'), words = `babylonjs ${version('babylonjs')}`;
    const scene = new BABYLON.Scene(new BABYLON.NullEngine());
    const mesh = new BABYLON.Mesh('ball', scene), data = new BABYLON.VertexData();
    Object.assign(data, { positions: base.v.flat(), indices: base.t.flatMap(([a, b, c]) => [a, c, b]), normals: base.n.flat() });
    data.applyToMesh(mesh);
    mesh.position.set(1, 2, 3);
    mesh.rotation.set(0.3, 0.2, 0.1);
    mesh.computeWorldMatrix(true);
    const other = mesh.clone('other');
    other.position.set(-5, 0, 1);
    other.computeWorldMatrix(true);
    const corners = [];
    for (const each of [mesh, other]) {
      const positions = each.getVerticesData('position');
      for (const v of each.getIndices()) corners.push(...BABYLON.Vector3.TransformCoordinates(BABYLON.Vector3.FromArray(positions, 3 * v), each.getWorldMatrix()).asArray());
    }
    const swapped = corners.map((_, k) => corners[k - (k % 3) + [0, 2, 1][k % 3]]);  // z upwards.
    for (const [name, binary] of [['babylon.stl', true], ['babylona.stl', false]]) {
      const out = serializers.STLExport.CreateSTL([mesh, other], false, 'x', binary, true, true, true);
      fs.writeFileSync(at(name), typeof out === 'string' ? out : Buffer.from(out.buffer));
      fact(name, words, { ...facts(swapped) });
    }
    fs.writeFileSync(at('babylon.obj'), serializers.OBJExport.OBJ([mesh, other], false, undefined, true));
    fact('babylon.obj', words, { triangles: corners.length / 9, area: facts(corners).area });
  },

  async jscad() {
    const { primitives, booleans, transforms, geometries } = require('@jscad/modeling'), words = `jscad ${version('@jscad/modeling')}`;
    const part = transforms.rotate([0.2, 0.3, 0], booleans.subtract(primitives.cuboid({ size: [10, 8, 4] }), primitives.cylinder({ radius: 2, height: 9, segments: 33 })));
    const polygons = geometries.geom3.toPolygons(part), corners = [];
    for (const { vertices } of polygons) {
      for (let k = 2; k < vertices.length; k++) corners.push(...vertices[0], ...vertices[k - 1], ...vertices[k]);
    }
    const wanted = facts(corners);
    for (const [name, serializer, options] of [['jscad.stl', '@jscad/stl-serializer', { binary: true }], ['jscada.stl', '@jscad/stl-serializer', { binary: false }],
      ['jscad.obj', '@jscad/obj-serializer', { triangulate: false }]]) {
      const out = require(serializer).serialize(options, part);
      fs.writeFileSync(at(name), Buffer.concat(out.map((piece) => (typeof piece === 'string' ? Buffer.from(piece) : Buffer.from(piece)))));
      fact(name, words, wanted);
    }
  },
};

await programs[program]();
