// The progressive mesh of the page goes to the count that the slider names, step by step, from wherever it is.
import {
  BufferAttribute, BufferGeometry, DynamicDrawUsage, GLSL3, Mesh, Matrix4, RawShaderMaterial, Sphere, Vector3,
} from "three";
import { GLIDE, TICK } from "./slides.js";

// Steps are taken for at most this long a frame, in milliseconds, so that the mesh can be turned meanwhile. Where pictures take
// longer themselves, as without a graphics card, half their time.
const LEAST_TIME = 8;
const MOST_TIME = 100;

// Vertices glide only where there are this many milliseconds a picture or fewer: otherwise a glide has no picture between its ends.
const SMOOTH = 50;

// At most this many ranges of an array are sent in a frame: the price of a call against that of bytes that have not changed.
const MOST_RANGES = 16;

// Flat faces under a lamp at the eye's side. Vertices glide from one place to another here, so that the script has no work with it.
const VERTEX_SHADER = `
precision highp float;
uniform mat4 modelViewMatrix, projectionMatrix;
uniform float clock;
in vec4 position, since;
#ifdef COLOURED
in vec4 colour, colourSince;
#endif
out vec3 at;
out vec3 paint;
void main() {
  float share = smoothstep(0.0, 1.0, (clock - 65535.0 * position.w) / ${(GLIDE / TICK).toFixed(1)});
  vec4 seen = modelViewMatrix * vec4(mix(since.xyz, position.xyz, share), 1.0);
  at = seen.xyz;
#ifdef COLOURED
  paint = pow(mix(colourSince.rgb, colour.rgb, share), vec3(2.2));
#else
  paint = vec3(0.59, 0.52, 0.42);
#endif
  gl_Position = projectionMatrix * seen;
}`;
const FRAGMENT_SHADER = `
precision highp float;
in vec3 at;
in vec3 paint;
out vec4 colour;
void main() {
#ifdef EDGES
  colour = vec4(0.13, 0.13, 0.13, 1.0);
#else
  vec3 normal = normalize(cross(dFdx(at), dFdy(at)));
  float light = 0.38 + 0.7 * max(0.0, dot(normal, vec3(0.2683, 0.3578, 0.8944)));
  colour = vec4(pow(paint * light, vec3(0.4545)), 1.0);
#endif
}`;

// The slider is logarithmic. `stage` has the scene and what the page does with it.
export function slide(slides, { scene, draw, look, ready, note }) {
  const geometry = new BufferGeometry();
  const attribute = (name, array, isNormalized) => {
    const made = new BufferAttribute(array, name ? 4 : 1, isNormalized).setUsage(DynamicDrawUsage);
    if (name) geometry.setAttribute(name, made); else geometry.setIndex(made);
    return made;
  };
  const ofVertices = [attribute("position", slides.place, true), attribute("since", slides.from, true)];
  if (slides.colour) ofVertices.push(attribute("colour", slides.colour, true), attribute("colourSince", slides.colourFrom, true));
  const index = attribute(null, slides.index, false);
  geometry.boundingSphere = new Sphere(new Vector3(0.5, 0.5, 0.5), 1);
  const uniforms = { clock: { value: slides.clock } };
  const material = (defines, more) => new RawShaderMaterial({
    glslVersion: GLSL3, vertexShader: VERTEX_SHADER, fragmentShader: FRAGMENT_SHADER, side: 2, uniforms,
    defines: slides.colour ? { COLOURED: 1, ...defines } : defines, ...more,
  });
  const mesh = new Mesh(geometry, material({}, { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 }));
  const edges = new Mesh(geometry, material({ EDGES: 1 }, { wireframe: true }));
  edges.visible = false;
  mesh.add(edges);
  // The longest side has a length of 2, its middle is the origin.
  mesh.applyMatrix4(new Matrix4().makeTranslation(-1, -1, -1).multiply(new Matrix4().makeScale(2, 2, 2)));
  scene.add(mesh);

  const slider = document.getElementById("viewer-slider");
  const count = document.getElementById("viewer-count");
  const wish = document.getElementById("viewer-edges");
  const isStill = window.matchMedia?.("(prefers-reduced-motion: reduce)").matches;
  const ratio = slides.finest / Math.max(slides.coarsest, 1);
  let wanted = slides.step;
  let isMoving = false;
  let last = 0;
  // Sends what has changed to the graphics card; returns how many bytes.
  const send = () => {
    let bytes = 0;
    const hand = (attribute, ranges) => {
      for (const [start, n] of ranges) {
        attribute.addUpdateRange(attribute.itemSize * start, attribute.itemSize * n);
        bytes += attribute.itemSize * n * attribute.array.BYTES_PER_ELEMENT;
      }
      if (ranges.length > 0) attribute.needsUpdate = true;
    };
    const ranges = slides.vertices.take(MOST_RANGES);
    for (const attribute of ofVertices) hand(attribute, ranges);
    hand(index, slides.corners.take(MOST_RANGES));
    return bytes;
  };
  const show = () => {
    geometry.setDrawRange(0, 3 * slides.drawn);
    uniforms.clock.value = slides.clock;
    // Edges are made of the whole index again whenever it changes, so they wait until it rests.
    edges.visible = wish.checked && !isMoving;
    count.textContent = slides.triangles.toLocaleString("en") + " triangles";
    document.body.dataset.triangles = slides.triangles;
    draw();
  };
  // Milliseconds of steps, of ranges and of the call to draw, and bytes sent, of the last frames: for those who measure.
  const frames = [];
  const frame = (now) => {
    const picture = last > 0 ? now - last : 0;
    last = now;
    const start = performance.now();
    const milliseconds = Math.min(Math.max(picture / 2, LEAST_TIME), MOST_TIME);
    isMoving = !slides.advance(wanted, now, { milliseconds, isGliding: picture <= SMOOTH && !isStill });
    const stepped = performance.now();
    const bytes = send();
    const sent = performance.now();
    show();
    if (frames.length > 4000) frames.length = 0;
    frames.push([stepped - start, sent - stepped, performance.now() - sent, bytes]);
    document.body.dataset.moving = isMoving;
    if (isMoving) requestAnimationFrame(frame); else last = 0;
  };
  slides.frames = frames;
  const move = () => {
    wanted = slides.stepFor(Math.round(Math.max(slides.coarsest, 1) * ratio ** (slider.value / slider.max)));
    if (!isMoving) {
      isMoving = true;
      requestAnimationFrame(frame);
    }
  };
  slider.addEventListener("input", move);
  wish.addEventListener("change", show);
  const [low, high] = [[1, 1, 1], [-1, -1, -1]];
  for (let i = 0; i < slides.place.length; i += 1) {
    if (i % 4 === 3) continue;
    const x = slides.place[i] / 32767.5 - 1;
    low[i % 4] = Math.min(low[i % 4], x);
    high[i % 4] = Math.max(high[i % 4], x);
  }
  const [least, most] = [new Vector3(...low), new Vector3(...high)];
  look(least.clone().add(most).multiplyScalar(0.5), most.distanceTo(least) / 2 || 1);
  // The first picture sends everything.
  slides.vertices.take(1);
  slides.corners.take(1);
  show();
  note.textContent = "Drag to turn, wheel to zoom, right button to move.";
  ready();
}
