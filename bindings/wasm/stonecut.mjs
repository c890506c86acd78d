// Simplifies triangle meshes by the kernel of stonecut, in browsers, workers and node.
//
//     import { simplify } from "stonecut";
//     const { positions, indices } = await simplify(positions, indices, { ratio: 0.1 });

const SUBSET = 1, KEEP_TOPOLOGY = 2, LOCK_BOUNDARY = 4, MAP = 8, FIT = 16;
const OPTIONS = ["triangles", "ratio", "placement", "topology", "lockBoundary", "map", "fit"];

let compiled;
let instance;

/// Compiles the module once: from the file beside this one, or from bytes, a Response or a WebAssembly.Module.
export async function load(source) {
    if (source !== undefined || !compiled) {
        instance = undefined;
        compiled = compile(source ?? new URL("./stonecut.wasm", import.meta.url));
        compiled.catch(() => (compiled = undefined));
    }
    await compiled;
}

async function compile(source) {
    if (source instanceof WebAssembly.Module) return source;
    if (source instanceof URL && source.protocol === "file:") {
        const { readFile } = await import(/* webpackIgnore: true */ "node:fs/promises");
        source = await readFile(source);
    }
    if (source instanceof ArrayBuffer || ArrayBuffer.isView(source)) return WebAssembly.compile(source);
    return WebAssembly.compileStreaming(source instanceof URL ? fetch(source) : source);
}

/// Simplifies a mesh to a count of triangles or a share of them.
///
/// `positions`: Float32Array or Float64Array, three a vertex; `indices`: Uint32Array or another array of integers, three a triangle.
/// Options: `triangles` or `ratio`; `placement: "subset"` (only vertices of the input), `topology: "keep"`, `lockBoundary: true`
/// (vertices at open edges stay), `fit: true` (also where more than 1 % are left), `map: true`.
/// Gives `{ positions, indices }`, positions of the type that was given, and `map`: for each vertex that was given the vertex of the
/// result that it became, or 0xffffffff. The arrays that are given are not changed.
export async function simplify(positions, indices, options = {}) {
    await load();
    instance ??= (await WebAssembly.instantiate(await compiled, {})).exports;
    return simplifyIn(instance, positions, indices, options);
}

function simplifyIn(wasm, positions, indices, options) {
    const unknown = Object.keys(options).find((name) => !OPTIONS.includes(name));
    if (unknown) throw new TypeError(`${unknown}: not an option; there are ${OPTIONS.join(", ")}`);
    if (!(positions instanceof Float32Array || positions instanceof Float64Array)) {
        throw new TypeError("positions: a Float32Array or a Float64Array is wanted");
    }
    if (positions.length % 3 || indices.length % 3) throw new RangeError("positions and indices: three numbers each are wanted");
    const [n, m] = [positions.length / 3, indices.length / 3];
    const target = wanted(options, m);
    let flags = options.placement === "subset" ? SUBSET : 0;
    if (options.topology === "keep") flags |= KEEP_TOPOLOGY;
    if (options.lockBoundary) flags |= LOCK_BOUNDARY;
    if (options.map) flags |= MAP;
    if (options.fit) flags |= FIT;
    let job = 0;
    try {
        job = wasm.stonecut_new(n, m);
        if (!job) throw new RangeError(`${n} vertices and ${m} triangles are too many for one mesh`);
        new Float64Array(wasm.memory.buffer, wasm.stonecut_positions(job), 3 * n).set(positions);
        new Uint32Array(wasm.memory.buffer, wasm.stonecut_triangles(job), 3 * m).set(indices);
        const code = wasm.stonecut_simplify(job, target, flags);
        if (code === 1) throw new RangeError(`indices: one is not below the ${n} vertices`);
        if (code === 2) throw new RangeError("positions: one is not finite");
        // Copies: the memory of the module is used again.
        const [left, kept] = [wasm.stonecut_n_vertices(job), wasm.stonecut_n_triangles(job)];
        const made = {
            positions: new positions.constructor(new Float64Array(wasm.memory.buffer, wasm.stonecut_positions(job), 3 * left)),
            indices: new Uint32Array(wasm.memory.buffer, wasm.stonecut_triangles(job), 3 * kept).slice(),
        };
        if (options.map) made.map = new Uint32Array(wasm.memory.buffer, wasm.stonecut_map(job), n).slice();
        wasm.stonecut_free(job);
        return made;
    } catch (error) {
        // A trap, for want of memory most of all, leaves the module in any state.
        if (error instanceof WebAssembly.RuntimeError) {
            instance = undefined;
            throw new Error(`simplifying ${m} triangles failed, perhaps for want of memory: ${error.message}`, { cause: error });
        }
        if (job) wasm.stonecut_free(job);
        throw error;
    }
}

function wanted({ triangles, ratio }, m) {
    if ((triangles === undefined) === (ratio === undefined)) throw new TypeError("give triangles or ratio, one of them");
    const target = triangles ?? Math.floor(ratio * m);
    const isShare = ratio === undefined || (ratio > 0 && ratio <= 1);
    if (!isShare || !(target >= 0)) throw new RangeError(`triangles or ratio: ${triangles ?? ratio} is out of range`);
    return Math.min(Math.floor(target), 0xffffffff);
}
