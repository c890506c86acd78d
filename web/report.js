// Shows the GLB embedded in the page, or the progressive mesh with a slider, to turn around with mouse or fingers.
import {
  AmbientLight, Box3, Color, DirectionalLight, LineBasicMaterial, LineSegments, MeshStandardMaterial, PerspectiveCamera, Scene,
  Vector3, WebGLRenderer, WireframeGeometry,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";
import { slide } from "./slider.js";
import { Slides } from "./slides.js";

const canvas = document.getElementById("viewer");
const note = document.getElementById("viewer-note");
const bytesOf = (id) => {
  const element = document.getElementById(id);
  return element && Uint8Array.from(atob(element.textContent.trim()), (c) => c.charCodeAt(0)).buffer;
};

// Without a graphics card smooth edges take most of the time of a picture (docs/results/methods.md#page-with-a-slider).
function isSoftware() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const about = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = about ? gl.getParameter(about.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

function start() {
  let renderer;
  try {
    renderer = new WebGLRenderer({ canvas, antialias: !isSoftware(), preserveDrawingBuffer: true });
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
      const slides = new Slides(progressive);
      slide(slides, { scene, draw, look, ready, note });
      window.slides = slides;
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

start();
