// A progressive mesh that goes to any number of triangles, step by step, both ways. The bytes are those of
// src/progressive/slides.rs (docs/format.md). Knows no page and no graphics, so that node can test it.

// Every step as lists into shared arrays: triangles that appear, triangles that go, corners that change, a vertex that moves.
export class Slides {
  constructor(buffer) {
    const view = new DataView(buffer);
    const magic = String.fromCharCode(...new Uint8Array(buffer, 0, 8));
    if (magic !== "stncuts1") throw new Error("not a progressive mesh of this version");
    const u32 = (at) => view.getUint32(at, true);
    const [baseVertices, baseTriangles, nVertices, nTriangles, nSteps, nPositions] = [8, 12, 16, 20, 24, 28].map(u32);
    const unit = view.getFloat64(56, true);
    const places = new Uint16Array(buffer, 64, 3 * nPositions);
    let at = 64 + 4 * Math.ceil((6 * nPositions) / 4);
    const base = new Uint32Array(buffer, at, 3 * baseTriangles);
    at += 12 * baseTriangles;
    const bytes = new Uint8Array(buffer);
    const next = () => {
      let value = 0;
      for (let shift = 0; ; shift += 7) {
        const byte = bytes[at++];
        value |= (byte & 127) << shift;
        if (byte < 128) return value >>> 0;
      }
    };
    this.unit = unit;
    this.nSteps = nSteps;
    // What graphics cards draw: places around the middle, longest side 2; triangles that are not there are points.
    this.position = new Float32Array(3 * nVertices);
    this.index = new Uint32Array(3 * nTriangles);
    this.index.set(base);
    this.made = new Uint32Array(3 * nTriangles);
    this.made.set(base);
    // For each step: triangles so far, and where its lists begin.
    this.vertexEnd = new Uint32Array(nSteps + 1);
    this.triangleEnd = new Uint32Array(nSteps + 1);
    this.live = new Uint32Array(nSteps + 1);
    this.changeEnd = new Uint32Array(nSteps + 1);
    this.goneEnd = new Uint32Array(nSteps + 1);
    this.moved = new Int32Array(nSteps).fill(-1);
    this.movedTo = new Uint16Array(3 * nSteps);
    this.movedFrom = new Uint16Array(3 * nSteps);
    const now = new Uint16Array(3 * nVertices);
    const changes = { corner: [], from: [], to: [] };
    const gone = { triangle: [], corners: [] };
    let place = 0;
    let vertex = 0;
    const addVertex = () => {
      for (let k = 0; k < 3; k += 1) now[3 * vertex + k] = places[3 * place + k];
      this.put(vertex, now, 3 * vertex);
      place += 1;
      vertex += 1;
    };
    while (vertex < baseVertices) addVertex();
    let triangle = baseTriangles;
    let live = baseTriangles;
    this.vertexEnd[0] = vertex;
    this.triangleEnd[0] = triangle;
    this.live[0] = live;
    const addTriangles = () => {
      for (let n = next(); n > 0; n -= 1) {
        for (let k = 0; k < 3; k += 1) this.index[3 * triangle + k] = this.made[3 * triangle + k] = vertex - 1 - next();
        triangle += 1;
        live += 1;
      }
    };
    const list = (each) => {
      let last = 0;
      for (let n = next(); n > 0; n -= 1) {
        last += next();
        each(last);
      }
    };
    const change = (to) => (corner) => {
      changes.corner.push(corner);
      changes.from.push(this.index[corner]);
      changes.to.push(to);
      this.index[corner] = to;
    };
    for (let step = 0; step < nSteps; step += 1) {
      if (next() === 0) {
        const kept = vertex - next();
        addVertex();
        this.moved[step] = kept;
        for (let k = 0; k < 3; k += 1) {
          this.movedFrom[3 * step + k] = now[3 * kept + k];
          this.movedTo[3 * step + k] = now[3 * kept + k] = places[3 * place + k];
        }
        this.put(kept, now, 3 * kept);
        place += 1;
        list(change(vertex - 1));
        addTriangles();
      } else {
        for (let n = next(); n > 0; n -= 1) addVertex();
        addTriangles();
        list((t) => {
          gone.triangle.push(t);
          gone.corners.push(...this.index.subarray(3 * t, 3 * t + 3));
          this.index.fill(0, 3 * t, 3 * t + 3);
          live -= 1;
        });
        for (let n = next(); n > 0; n -= 1) list(change(next()));
      }
      this.vertexEnd[step + 1] = vertex;
      this.triangleEnd[step + 1] = triangle;
      this.live[step + 1] = live;
      this.changeEnd[step + 1] = changes.corner.length;
      this.goneEnd[step + 1] = gone.triangle.length;
    }
    if (vertex !== nVertices || triangle !== nTriangles || place !== nPositions) throw new Error("the mesh is cut off");
    this.corner = Uint32Array.from(changes.corner);
    this.from = Uint32Array.from(changes.from);
    this.to = Uint32Array.from(changes.to);
    this.goneTriangle = Uint32Array.from(gone.triangle);
    this.goneCorners = Uint32Array.from(gone.corners);
    this.step = nSteps;
  }

  put(vertex, places, at) {
    for (let k = 0; k < 3; k += 1) this.position[3 * vertex + k] = places[at + k] / 32767.5 - 1;
  }

  // Triangles of the mesh at hand; numbers that are drawn.
  get triangles() { return this.live[this.step]; }
  get drawn() { return this.triangleEnd[this.step]; }
  get coarsest() { return this.live[0]; }
  get finest() { return this.live[this.nSteps]; }

  forward() {
    const s = this.step;
    for (let i = 3 * this.triangleEnd[s]; i < 3 * this.triangleEnd[s + 1]; i += 1) this.index[i] = this.made[i];
    for (let g = this.goneEnd[s]; g < this.goneEnd[s + 1]; g += 1) {
      this.index.fill(0, 3 * this.goneTriangle[g], 3 * this.goneTriangle[g] + 3);
    }
    for (let c = this.changeEnd[s]; c < this.changeEnd[s + 1]; c += 1) this.index[this.corner[c]] = this.to[c];
    if (this.moved[s] >= 0) this.put(this.moved[s], this.movedTo, 3 * s);
    this.step += 1;
  }

  back() {
    const s = this.step - 1;
    if (this.moved[s] >= 0) this.put(this.moved[s], this.movedFrom, 3 * s);
    for (let c = this.changeEnd[s + 1]; c > this.changeEnd[s]; c -= 1) this.index[this.corner[c - 1]] = this.from[c - 1];
    for (let g = this.goneEnd[s]; g < this.goneEnd[s + 1]; g += 1) {
      for (let k = 0; k < 3; k += 1) this.index[3 * this.goneTriangle[g] + k] = this.goneCorners[3 * g + k];
    }
    this.index.fill(0, 3 * this.triangleEnd[s], 3 * this.triangleEnd[s + 1]);
    this.step = s;
  }

  // The step at which the mesh is the finest of at most n triangles, or the coarsest.
  stepFor(n) {
    let [low, high] = [0, this.nSteps];
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.live[middle] <= n) low = middle; else high = middle - 1;
    }
    return low;
  }

  // Goes towards a step until it is there or the time is up; returns whether it is there.
  go(wanted, milliseconds = Infinity) {
    const end = performance.now() + milliseconds;
    while (this.step !== wanted) {
      for (let n = 0; n < 256 && this.step !== wanted; n += 1) {
        if (this.step < wanted) this.forward(); else this.back();
      }
      if (performance.now() > end) break;
    }
    return this.step === wanted;
  }
}
