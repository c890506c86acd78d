// The page of `stonecut tiles --viewer`: NASA's 3d-tiles-renderer over three.js. See README.md.
//
// The address may say: ?error=16 (pixels) or ?triangles=2000000 (in the picture, at most), &view=x,y,z,tx,ty,tz (camera and its target, y upwards), &back=ff0000,
// &plain (white, without light), &still (no panel). `document.title` begins with "settled" when everything is loaded.
import { Color, DirectionalLight, HemisphereLight, Matrix4, MeshBasicMaterial, DoubleSide, PerspectiveCamera, Scene,
  Sphere, Vector3, WebGLRenderer } from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import { GLTFLoader } from 'three/examples/jsm/loaders/GLTFLoader.js';
import { MeshoptDecoder } from 'three/examples/jsm/libs/meshopt_decoder.module.js';
import { TilesRenderer } from '3d-tiles-renderer/three';

// Without a graphics card smooth edges take half of the time of a picture.
function isSoftware() {
  const gl = document.createElement('canvas').getContext('webgl2');
  const about = gl?.getExtension('WEBGL_debug_renderer_info');
  const name = about ? gl.getParameter(about.UNMASKED_RENDERER_WEBGL) : '';
  gl?.getExtension('WEBGL_lose_context')?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

const words = new URLSearchParams(location.search);
const renderer = new WebGLRenderer({ antialias: !words.has('still') && !isSoftware(), logarithmicDepthBuffer: true });
renderer.setPixelRatio(words.has('still') ? 1 : window.devicePixelRatio);
document.body.appendChild(renderer.domElement);
const scene = new Scene();
scene.background = new Color('#' + (words.get('back') || '20242a'));
const camera = new PerspectiveCamera(50, 1, 0.001, 1e6);
const controls = new OrbitControls(camera, renderer.domElement);
controls.enableDamping = true;
const sun = new DirectionalLight(0xffffff, 2.2);
camera.add(sun);
sun.position.set(-0.6, 0.9, 1);
scene.add(camera, new HemisphereLight(0xe8f0ff, 0x59503f, 1.3));

const tiles = new TilesRenderer('./tileset.json');
const loader = new GLTFLoader(tiles.manager);
loader.setMeshoptDecoder(MeshoptDecoder);
tiles.manager.addHandler(/\.(gltf|glb)$/, loader);
tiles.errorTarget = Number(words.get('error')) || 16;
tiles.lruCache.maxBytesSize = 1.5e9;
tiles.lruCache.minBytesSize = 1.0e9;
tiles.setCamera(camera);
scene.add(tiles.group);

if (words.has('plain')) {
  const white = new MeshBasicMaterial({ color: 0xffffff, side: DoubleSide });
  tiles.addEventListener('load-model', ({ scene }) => scene.traverse(o => { if (o.isMesh) o.material = white; }));
}

// Pixels of error between which the count is met.
const [LEAST_ERROR, MOST_ERROR] = [0.25, 4096];

let framed = false;
function frame() {
  if (framed || !tiles.root) return;
  framed = true;
  // Back from the globe into the frame of the mesh, and z upwards becomes y upwards.
  const placed = new Matrix4();
  if (tiles.root.transform) placed.fromArray(tiles.root.transform);
  const upright = new Matrix4().makeRotationX(-Math.PI / 2);
  tiles.group.matrixAutoUpdate = false;
  tiles.group.matrix.copy(upright.multiply(placed.invert()));
  tiles.group.updateMatrixWorld(true);
  const ball = new Sphere();
  tiles.getBoundingSphere(ball);
  ball.applyMatrix4(tiles.group.matrixWorld);
  const box = tiles.root.boundingVolume.box;
  const size = Math.hypot(box[3], box[7], box[11]);
  camera.near = size / 1e4;
  camera.far = size * 100;
  const view = (words.get('view') || '').split(',').map(Number);
  if (view.length === 6 && view.every(Number.isFinite)) {
    camera.position.fromArray(view);
    controls.target.fromArray(view, 3);
  } else {
    controls.target.set(box[0], box[2], -box[1]);
    camera.position.copy(controls.target).add(new Vector3(0.5, 0.6, 1).setLength(size * 2));
  }
  camera.updateProjectionMatrix();
  controls.update();
}
tiles.addEventListener('load-root-tileset', frame);

const panel = document.getElementById('panel');
const facts = document.getElementById('facts');
const error = document.getElementById('error');
const count = document.getElementById('count');

// Either slider rules, the one that was moved last; the other one follows. With a count, the error is looked for between one
// that shows too many triangles and one that does not, by halves, whenever everything is loaded.
let budget = Number(words.get('triangles')) || 0;
let [tooFine, coarse] = [0, Infinity];
const search = () => { [tooFine, coarse] = [0, Infinity]; };
controls.addEventListener('change', search);
error.addEventListener('input', () => { budget = 0; tiles.errorTarget = 2 ** Number(error.value); });
count.addEventListener('input', () => { budget = 2 ** Number(count.value); search(); });
function keepCount(triangles) {
  const now = tiles.errorTarget;
  if (triangles > budget) tooFine = now; else coarse = now;
  if (coarse / tooFine < 1.05) {
    tiles.errorTarget = coarse;
    return;
  }
  const step = Math.min(Math.max(Math.sqrt(triangles / budget), 0.25), 4);
  const next = tooFine && coarse < Infinity ? Math.sqrt(tooFine * coarse) : now * (triangles > budget ? Math.max(step, 1.1) : Math.min(step, 0.9));
  tiles.errorTarget = Math.min(Math.max(next, LEAST_ERROR), MOST_ERROR);
}
if (words.has('still')) panel.style.display = 'none';

function resize() {
  renderer.setSize(innerWidth, innerHeight);
  camera.aspect = innerWidth / innerHeight;
  camera.updateProjectionMatrix();
  tiles.setResolutionFromRenderer(camera, renderer);
}
addEventListener('resize', resize);
resize();

let quiet = 0;
renderer.setAnimationLoop(() => {
  frame();
  controls.update();
  camera.updateMatrixWorld();
  tiles.update();
  renderer.render(scene, camera);
  const { downloading = 0, parsing = 0, queued = 0, failed = 0 } = tiles.stats;
  const shown = tiles.visibleTiles.size;
  quiet = framed && shown > 0 && downloading + parsing + queued === 0 ? quiet + 1 : 0;
  const triangles = renderer.info.render.triangles;
  // A new error takes a frame to show.
  if (budget > 0 && quiet > 2) {
    const before = tiles.errorTarget;
    keepCount(triangles);
    if (tiles.errorTarget !== before) quiet = 0;
  }
  error.value = Math.log2(tiles.errorTarget);
  if (budget === 0) count.value = Math.log2(Math.max(triangles, 1));
  facts.textContent = `${shown} tiles, ${(triangles / 1e6).toFixed(2)} M triangles, ` +
    `${tiles.errorTarget.toFixed(0)} px` + (downloading + parsing ? `, ${downloading + parsing} loading` : '') +
    (failed ? `, ${failed} failed` : '');
  document.title = (quiet > 30 ? 'settled ' : '') + facts.textContent;
});
