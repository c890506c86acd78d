// Shows the GLB embedded in the page, or the progressive mesh with a slider, to turn around with mouse or fingers.
import {
  AmbientLight, Box3, BufferAttribute, BufferGeometry, Color, DirectionalLight, DynamicDrawUsage, LineBasicMaterial,
  LineSegments, Mesh, MeshStandardMaterial, PerspectiveCamera, Scene, Sphere, Vector3, WebGLRenderer, WireframeGeometry,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";
import { Slides } from "./slides.js";

const canvas = document.getElementById("viewer");
const note = document.getElementById("viewer-note");
const bytesOf = (id) => {
  const element = document.getElementById(id);
  return element && Uint8Array.from(atob(element.textContent.trim()), (c) => c.charCodeAt(0)).buffer;
};

function start() {
  let renderer;
  try {
    renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
  } catch (error) {
    note.textContent = "This browser shows no 3D pictures (WebGL is off).";
    return;
  }
  const scene = new Scene();
  scene.background = new Color(0xf4f2ee);
  const camera = new PerspectiveCamera(35, 4 / 3, 0.01, 100);
  const controls = new OrbitControls(camera, canvas);
  scene.add(new AmbientLight(0xffffff, 1.2));
  const lamp = new DirectionalLight(0xffffff, 2.2);
  camera.add(lamp);
  lamp.position.set(0.6, 0.8, 1);
  scene.add(camera);
  const edges = [];
  const draw = () => renderer.render(scene, camera);
  const resize = () => {
    const { clientWidth: width, clientHeight: height } = canvas;
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    draw();
  };
  const look = (centre, radius) => {
    camera.position.copy(centre).add(new Vector3(0.9, 0.7, 1.6).normalize().multiplyScalar(radius * 3.2));
    camera.near = radius / 100;
    camera.far = radius * 20;
    controls.target.copy(centre);
    controls.update();
    controls.addEventListener("change", draw);
    window.addEventListener("resize", resize);
    resize();
  };
  // Says how much of the picture is not background, so that a test can tell it from a blank one.
  const ready = () => {
    const gl = renderer.getContext();
    const pixels = new Uint8Array(4 * gl.drawingBufferWidth * gl.drawingBufferHeight);
    gl.readPixels(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    let drawn = 0;
    for (let i = 0; i < pixels.length; i += 4) {
      if (Math.abs(pixels[i] - pixels[0]) + Math.abs(pixels[i + 2] - pixels[2]) > 12) drawn += 1;
    }
    document.body.dataset.drawn = (400 * drawn / pixels.length).toFixed(1);
    document.body.dataset.viewer = "ready";
  };
  const progressive = bytesOf("slides");
  if (progressive) {
    try {
      slide(new Slides(progressive), { scene, draw, look, ready });
    } catch (error) {
      note.textContent = "The model cannot be shown: " + error;
    }
    return;
  }
  new GLTFLoader().parse(bytesOf("glb"), "", (gltf) => {
    const meshes = [];
    gltf.scene.traverse((node) => { if (node.isMesh) meshes.push(node); });
    for (const mesh of meshes) {
      if (!mesh.geometry.attributes.normal) mesh.geometry.computeVertexNormals();
      const vertexColors = Boolean(mesh.geometry.attributes.color);
      mesh.material = new MeshStandardMaterial({ color: vertexColors ? 0xffffff : 0xcabfae, vertexColors, roughness: 0.85, side: 2 });
      const lines = new LineSegments(new WireframeGeometry(mesh.geometry), new LineBasicMaterial({ color: 0x222222 }));
      lines.visible = false;
      edges.push(lines);
      mesh.add(lines);
    }
    scene.add(gltf.scene);
    const box = new Box3().setFromObject(gltf.scene);
    document.getElementById("viewer-edges").addEventListener("change", (event) => {
      for (const lines of edges) lines.visible = event.target.checked;
      draw();
    });
    look(box.getCenter(new Vector3()), box.getSize(new Vector3()).length() / 2 || 1);
    note.textContent = "Drag to turn, wheel to zoom, right button to move.";
    ready();
  }, (error) => { note.textContent = "The model cannot be shown: " + error; });
}

// Steps are taken for at most this long a frame, in milliseconds, so that the mesh can be turned meanwhile.
const FRAME = 12;

// The mesh goes to the count that the slider names, step by step, from wherever it is. The slider is logarithmic.
function slide(slides, { scene, draw, look, ready }) {
  const geometry = new BufferGeometry();
  const position = new BufferAttribute(slides.position, 3).setUsage(DynamicDrawUsage);
  const index = new BufferAttribute(slides.index, 1).setUsage(DynamicDrawUsage);
  geometry.setAttribute("position", position);
  geometry.setIndex(index);
  geometry.boundingSphere = new Sphere(new Vector3(), 2);
  const material = new MeshStandardMaterial({ color: 0xcabfae, roughness: 0.85, side: 2, flatShading: true });
  const mesh = new Mesh(geometry, material);
  scene.add(mesh);
  const slider = document.getElementById("viewer-slider");
  const count = document.getElementById("viewer-count");
  const ratio = slides.finest / Math.max(slides.coarsest, 1);
  let wanted = slides.step;
  let isMoving = false;
  const show = () => {
    geometry.setDrawRange(0, 3 * slides.drawn);
    position.needsUpdate = true;
    index.needsUpdate = true;
    count.textContent = slides.triangles.toLocaleString("en") + " triangles";
    document.body.dataset.triangles = slides.triangles;
    draw();
  };
  const frame = () => {
    isMoving = !slides.go(wanted, FRAME);
    show();
    if (isMoving) requestAnimationFrame(frame);
  };
  slider.addEventListener("input", () => {
    wanted = slides.stepFor(Math.round(Math.max(slides.coarsest, 1) * ratio ** (slider.value / slider.max)));
    if (!isMoving) {
      isMoving = true;
      requestAnimationFrame(frame);
    }
  });
  document.getElementById("viewer-edges").addEventListener("change", (event) => {
    mesh.material.wireframe = event.target.checked;
    draw();
  });
  geometry.computeBoundingBox();
  look(geometry.boundingBox.getCenter(new Vector3()), geometry.boundingBox.getSize(new Vector3()).length() / 2 || 1);
  show();
  note.textContent = "Drag to turn, wheel to zoom, right button to move.";
  ready();
}

start();
