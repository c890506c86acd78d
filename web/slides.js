// A progressive mesh that goes to any number of triangles, step by step, both ways. The bytes are those of
// src/progressive/slides.rs (docs/format.md). Knows no page and no graphics, so that node can test it.

// Milliseconds that a vertex glides, and that one tick of the clock of vertices lasts.
export const GLIDE = 160;
export const TICK = 4;
const GLIDE_TICKS = GLIDE / TICK;

// What is sent to the graphics card is counted in pages of so many corners or vertices (a power of 2).
const PAGE_BITS = 7;

// The numbers of a step: where its lists begin, triangles so far, the vertex that moves or -1, and the place it comes from.
const [VERTEX, TRIANGLE, CHANGE, GONE, PLACE, LIVE, MOVED, FROM] = [0, 1, 2, 3, 4, 5, 6, 7];

const between = (from, to, share) => (share === 1 ? to : Math.round(from + (to - from) * share));

// A list of numbers that grows.
class Numbers {
  constructor(n) {
    this.all = new Int32Array(Math.max(n, 16));
    this.length = 0;
  }

  push(x) {
    if (this.length === this.all.length) {
      const more = new Int32Array(2 * this.length);
      more.set(this.all);
      this.all = more;
    }
    this.all[this.length] = x;
    this.length += 1;
  }
}

// Pages that have changed.
class Pages {
  constructor(n) {
    this.n = n;
    this.dirty = new Uint8Array((n >> PAGE_BITS) + 1);
  }

  mark(i) { this.dirty[i >> PAGE_BITS] = 1; }

  // What has changed since the last call: at most `most` pairs of a start and a count; near ones are joined.
  take(most) {
    const { dirty, n } = this;
    let runs = [];
    for (let page = dirty.indexOf(1); page >= 0; page = dirty.indexOf(1, page)) {
      const start = page;
      while (dirty[page] === 1) page += 1;
      runs.push([start, page]);
    }
    dirty.fill(0);
    for (let gap = 1; runs.length > most; gap *= 2) {
      const joined = [];
      for (const run of runs) {
        const last = joined[joined.length - 1];
        if (last && run[0] - last[1] <= gap) last[1] = run[1]; else joined.push(run);
      }
      runs = joined;
    }
    return runs.map(([from, to]) => [from << PAGE_BITS, Math.min(n, to << PAGE_BITS) - (from << PAGE_BITS)]);
  }
}

// The mesh at hand has taken `step` steps. On the way down it lags behind `aim`: vertices glide to where the steps between
// put them before triangles go. On the way up triangles come first, and vertices glide from the place of the one they split from.
export class Slides {
  constructor(buffer) {
    const view = new DataView(buffer);
    const magic = String.fromCharCode(...new Uint8Array(buffer, 0, 8));
    if (magic !== "stncuts2") throw new Error("not a progressive mesh of this version");
    const u32 = (at) => view.getUint32(at, true);
    const [baseVertices, baseTriangles, nVertices, nTriangles, nSteps, nPlaces, hasColours] = [8, 12, 16, 20, 24, 28, 32].map(u32);
    let at = 72;
    const after = (bytes) => { at += 4 * Math.ceil(bytes / 4); };
    this.places = new Uint16Array(buffer, at, 3 * nPlaces);
    after(6 * nPlaces);
    this.colours = hasColours ? new Uint8Array(buffer, at, 3 * nPlaces) : null;
    if (hasColours) after(3 * nPlaces);
    const base = new Uint32Array(buffer, at, 3 * baseTriangles);
    after(12 * baseTriangles);
    this.nSteps = nSteps;
    // What graphics cards draw: places in 65,535ths of the longest side with the tick since which they glide, the places they
    // glide from, colours alike; triangles that are not there are points.
    this.place = new Uint16Array(4 * nVertices);
    this.from = new Uint16Array(4 * nVertices);
    this.colour = hasColours ? new Uint8Array(4 * nVertices) : null;
    this.colourFrom = hasColours ? new Uint8Array(4 * nVertices) : null;
    this.index = new Uint32Array(3 * nTriangles);
    this.index.set(base);
    // Corners of each triangle as it came, and for each vertex the number of the place it goes to.
    this.made = new Uint32Array(3 * nTriangles);
    this.made.set(base);
    this.placeOf = new Uint32Array(nVertices);
    this.corners = new Pages(3 * nTriangles);
    this.vertices = new Pages(nVertices);
    this.clock = GLIDE_TICKS;
    this.zero = null;
    this.lastGlide = 0;
    this.isGliding = false;
    this.due = [];
    this.read(new Uint8Array(buffer), at, baseVertices, baseTriangles);
    const isWhole = this.step === nSteps && this.vertexEnd === nVertices && this.drawn === nTriangles;
    if (!isWhole || this.steps[8 * nSteps + PLACE] !== nPlaces) throw new Error("the mesh is cut off");
  }

  // Takes all steps once, and notes what each changes.
  read(bytes, at, baseVertices, baseTriangles) {
    const { index, made, nSteps, placeOf } = this;
    const steps = new Int32Array(8 * (nSteps + 1));
    const changes = new Numbers(24 * nSteps);
    const gone = new Numbers(16);
    let [vertex, triangle, place, live] = [0, baseTriangles, 0, baseTriangles];
    const next = () => {
      let byte = bytes[at++];
      let value = byte & 127;
      for (let shift = 7; byte >= 128; shift += 7) {
        byte = bytes[at++];
        value |= (byte & 127) << shift;
      }
      return value;
    };
    const addVertex = () => { placeOf[vertex++] = place++; };
    const addTriangles = () => {
      for (let n = next(); n > 0; n -= 1) {
        for (let k = 0; k < 3; k += 1) index[3 * triangle + k] = made[3 * triangle + k] = vertex - 1 - next();
        triangle += 1;
        live += 1;
      }
    };
    const changeTo = (to) => {
      let corner = 0;
      for (let n = next(); n > 0; n -= 1) {
        corner += next();
        changes.push(corner);
        changes.push(index[corner]);
        changes.push(to);
        index[corner] = to;
      }
    };
    const note = (step, moved, from) => steps.set([vertex, triangle, changes.length, gone.length, place, live, moved, from], 8 * step);
    while (vertex < baseVertices) addVertex();
    note(0, -1, 0);
    for (let step = 0; step < nSteps; step += 1) {
      if (next() === 0) {
        const kept = vertex - next();
        steps[8 * step + MOVED] = kept;
        steps[8 * step + FROM] = placeOf[kept];
        addVertex();
        placeOf[kept] = place++;
        changeTo(vertex - 1);
        addTriangles();
      } else {
        for (let n = next(); n > 0; n -= 1) addVertex();
        addTriangles();
        let t = 0;
        for (let n = next(); n > 0; n -= 1) {
          t += next();
          gone.push(t);
          for (let k = 0; k < 3; k += 1) {
            gone.push(index[3 * t + k]);
            index[3 * t + k] = 0;
          }
          live -= 1;
        }
        for (let n = next(); n > 0; n -= 1) changeTo(next());
      }
      note(step + 1, -1, 0);
    }
    this.steps = steps;
    this.changes = changes.all.slice(0, changes.length);
    this.gone = gone.all.slice(0, gone.length);
    this.step = this.aim = nSteps;
    for (let v = 0; v < vertex; v += 1) this.put(v, placeOf[v]);
  }

  // Triangles that are shown or on the way; numbers that are drawn.
  get triangles() { return this.live(this.aim); }
  get drawn() { return this.steps[8 * this.step + TRIANGLE]; }
  get vertexEnd() { return this.steps[8 * this.step + VERTEX]; }
  get coarsest() { return this.live(0); }
  get finest() { return this.live(this.nSteps); }

  live(step) { return this.steps[8 * step + LIVE]; }

  // The share of its glide that a vertex has behind it.
  share(vertex) {
    const share = (this.clock - this.place[4 * vertex + 3]) / GLIDE_TICKS;
    return share >= 1 ? 1 : share * share * (3 - 2 * share);
  }

  // A vertex comes to a place at once.
  put(vertex, p) {
    const { place, from, places, colour, colourFrom, colours } = this;
    this.placeOf[vertex] = p;
    this.vertices.mark(vertex);
    for (let i = 4 * vertex, q = 3 * p; q < 3 * p + 3; i += 1, q += 1) {
      place[i] = from[i] = places[q];
      if (colours !== null) colour[i] = colourFrom[i] = colours[q];
    }
  }

  // A vertex glides to a place from where another one, or it, is shown now.
  glide(vertex, p, other) {
    const { place, from, places, colour, colourFrom, colours } = this;
    const share = this.share(other);
    this.placeOf[vertex] = p;
    this.vertices.mark(vertex);
    for (let i = 4 * vertex, o = 4 * other, q = 3 * p; q < 3 * p + 3; i += 1, o += 1, q += 1) {
      from[i] = between(from[o], place[o], share);
      place[i] = places[q];
      if (colours === null) continue;
      colourFrom[i] = between(colourFrom[o], colour[o], share);
      colour[i] = colours[q];
    }
    place[4 * vertex + 3] = this.lastGlide = Math.floor(this.clock);
  }

  // Sends a vertex to a place, the one way or the other.
  send(vertex, p, other = vertex) {
    if (this.isGliding) this.glide(vertex, p, other); else this.put(vertex, p);
  }

  // Takes the triangles of the next step.
  forward() {
    const { steps, index, made, changes, gone, corners } = this;
    const s = 8 * this.step;
    for (let i = 3 * steps[s + TRIANGLE]; i < 3 * steps[s + 8 + TRIANGLE]; i += 1) {
      index[i] = made[i];
      corners.mark(i);
    }
    for (let g = steps[s + GONE]; g < steps[s + 8 + GONE]; g += 4) {
      index.fill(0, 3 * gone[g], 3 * gone[g] + 3);
      corners.mark(3 * gone[g]);
      corners.mark(3 * gone[g] + 2);
    }
    for (let c = steps[s + CHANGE]; c < steps[s + 8 + CHANGE]; c += 3) {
      index[changes[c]] = changes[c + 2];
      corners.mark(changes[c]);
    }
    this.step += 1;
  }

  // Takes the triangles of the last step back.
  back() {
    this.step -= 1;
    const { steps, index, changes, gone, corners } = this;
    const s = 8 * this.step;
    for (let c = steps[s + 8 + CHANGE] - 3; c >= steps[s + CHANGE]; c -= 3) {
      index[changes[c]] = changes[c + 1];
      corners.mark(changes[c]);
    }
    for (let g = steps[s + GONE]; g < steps[s + 8 + GONE]; g += 4) {
      for (let k = 0; k < 3; k += 1) index[3 * gone[g] + k] = gone[g + 1 + k];
      corners.mark(3 * gone[g]);
      corners.mark(3 * gone[g] + 2);
    }
    // Beyond what is drawn nothing needs to be sent: it is written again before it is drawn.
    index.fill(0, 3 * steps[s + TRIANGLE], 3 * steps[s + 8 + TRIANGLE]);
  }

  // Aims at the mesh before a step: the vertex that was split goes back.
  coarser() {
    this.aim -= 1;
    const s = 8 * this.aim;
    if (this.steps[s + MOVED] >= 0) this.send(this.steps[s + MOVED], this.steps[s + FROM]);
  }

  // Aims at the mesh behind a step. New vertices begin where the one that is split is shown, unless they are still there.
  finer() {
    const { steps } = this;
    const [s, isThere] = [8 * this.aim, this.aim < this.step];
    const [kept, vertex, place] = [steps[s + MOVED], steps[s + VERTEX], steps[s + PLACE]];
    if (!isThere) this.forward();
    if (kept >= 0) {
      this.send(vertex, place, isThere ? vertex : kept);
      this.send(kept, place + 1);
    } else if (!isThere) {
      for (let i = 0; vertex + i < steps[s + 8 + VERTEX]; i += 1) this.put(vertex + i, place + i);
    }
    this.aim += 1;
  }

  // Vertices that are about to go follow the ones that they go into.
  follow() {
    const { steps, placeOf } = this;
    for (let step = this.aim; step < this.step; step += 1) {
      const kept = steps[8 * step + MOVED];
      const gone = steps[8 * step + VERTEX];
      if (kept >= 0 && placeOf[gone] !== placeOf[kept]) this.glide(gone, placeOf[kept], gone);
    }
  }

  // The step at which the mesh is the finest of at most n triangles, or the coarsest.
  stepFor(n) {
    let [low, high] = [0, this.nSteps];
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.live(middle) <= n) low = middle; else high = middle - 1;
    }
    return low;
  }

  // Goes towards a step for some milliseconds; `now` is the time of the frame in milliseconds. Returns whether all is at rest there.
  advance(wanted, now, { milliseconds = Infinity, isGliding = false } = {}) {
    this.tick(now);
    this.isGliding = isGliding;
    const before = this.aim;
    const end = performance.now() + milliseconds;
    while (this.aim !== wanted) {
      for (let n = 0; n < 256 && this.aim !== wanted; n += 1) {
        if (this.aim > wanted) this.coarser(); else this.finer();
      }
      if (performance.now() > end) break;
    }
    if (this.aim < this.step && this.aim !== before && isGliding) {
      this.follow();
      this.due.push([this.aim, this.lastGlide + GLIDE_TICKS]);
    }
    while (this.due.length > 0 && (!isGliding || this.due[0][1] <= this.clock)) {
      const low = Math.max(this.due.shift()[0], this.aim);
      while (this.step > low) this.back();
    }
    if (this.due.length === 0) while (this.step > this.aim) this.back();
    return this.aim === wanted && this.step === wanted && this.clock >= this.lastGlide + GLIDE_TICKS;
  }

  // The same at once.
  go(wanted, milliseconds = Infinity) {
    return this.advance(wanted, this.lastNow ?? 0, { milliseconds });
  }

  // Vertices have 16 bits for the tick they begin at, so the clock begins again now and then: then all are at their places.
  tick(now) {
    this.lastNow = now;
    this.zero ??= now - GLIDE;
    this.clock = (now - this.zero) / TICK;
    if (this.clock < 60_000) return;
    this.from.set(this.place);
    this.colourFrom?.set(this.colour);
    for (let v = 0; v < this.placeOf.length; v += 1) this.place[4 * v + 3] = 0;
    this.due = this.due.map(([aim]) => [aim, 0]);
    this.vertices.dirty.fill(1);
    this.zero = now - GLIDE;
    this.clock = GLIDE_TICKS;
    this.lastGlide = 0;
  }
}
