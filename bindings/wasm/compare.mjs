// Times this package beside npm's meshoptimizer, and writes both results for `stonecut measure`:
//
//     node compare.mjs IN.ply RATIO... [--out FOLDER] [--browser]   (float PLY, little-endian, of triangles alone; npm i meshoptimizer before)
//
// CPU seconds in node; with --browser seconds of a worker in a page.
import { readFileSync, writeFileSync } from "node:fs";
import { browser, inBrowser } from "./browser.mjs";
import { simplify } from "./stonecut.mjs";

const words = process.argv.slice(2);
const inPage = words.includes("--browser");
if (inPage) words.splice(words.indexOf("--browser"), 1);
const at = words.indexOf("--out");
const folder = at < 0 ? "." : words.splice(at, 2)[1];
const [input, ...ratios] = words;
const { MeshoptSimplifier } = await import("meshoptimizer");
await MeshoptSimplifier.ready;

function read(path) {
    const bytes = readFileSync(path);
    const end = bytes.indexOf("end_header\n") + 11;
    const header = bytes.subarray(0, end).toString("latin1");
    const [n, m] = ["vertex", "face"].map((name) => Number(header.match(new RegExp(`element ${name} (\\d+)`))[1]));
    const positions = new Float32Array(bytes.buffer.slice(bytes.byteOffset + end, bytes.byteOffset + end + 12 * n));
    const indices = new Uint32Array(3 * m);
    for (let t = 0, place = end + 12 * n; t < m; t++, place += 13) {
        for (let k = 0; k < 3; k++) indices[3 * t + k] = bytes.readUInt32LE(place + 1 + 4 * k);
    }
    return [positions, indices];
}

function write(path, positions, indices) {
    const [n, m] = [positions.length / 3, indices.length / 3];
    const rows = Buffer.alloc(13 * m);
    for (let t = 0; t < m; t++) {
        rows[13 * t] = 3;
        for (let k = 0; k < 3; k++) rows.writeUInt32LE(indices[3 * t + k], 13 * t + 1 + 4 * k);
    }
    const header = `ply\nformat binary_little_endian 1.0\nelement vertex ${n}\nproperty float x\nproperty float y\nproperty float z\n`
        + `element face ${m}\nproperty list uchar int vertex_indices\nend_header\n`;
    writeFileSync(path, Buffer.concat([Buffer.from(header), Buffer.from(positions.buffer, positions.byteOffset, 12 * n), rows]));
}

const RUNS = 5;
/// Both peers, by name: arrays and a ratio in, arrays out.
const PEERS = {
    stonecut: (positions, indices, ratio) => simplify(positions, indices, { ratio }),
    meshoptimizer: async (positions, indices, ratio) => {
        const wanted = 3 * Math.floor((ratio * indices.length) / 3);
        const [left] = MeshoptSimplifier.simplify(indices, positions, 3, wanted, 1e9);
        return { positions, indices: left };
    },
};

/// The least seconds of each peer, and what it made, in this process.
async function inNode(name, positions, indices, ratio) {
    const times = [];
    let made;
    for (let k = 0; k < RUNS; k++) {
        const begun = process.cpuUsage();
        made = await PEERS[name](positions, indices, ratio);
        const { user, system } = process.cpuUsage(begun);
        times.push((user + system) / 1e6);
    }
    return { ...made, seconds: Math.min(...times) };
}

/// The same in a worker of a page.
async function inWorker(name, positions, indices, ratio) {
    const bytes = ({ buffer, byteOffset, byteLength }) => Buffer.from(buffer, byteOffset, byteLength);
    const worker = `import { simplify } from "/stonecut.mjs";
        import { MeshoptSimplifier } from "/node_modules/meshoptimizer/meshopt_simplifier.js";
        await MeshoptSimplifier.ready;
        const peer = ${PEERS[name]};
        const get = async (path) => (await fetch(path)).arrayBuffer();
        const [positions, indices] = [new Float32Array(await get("/positions")), new Uint32Array(await get("/indices"))];
        const times = [];
        let made;
        for (let k = 0; k < ${RUNS}; k++) {
            const begun = performance.now();
            made = await peer(positions, indices, ${ratio});
            times.push((performance.now() - begun) / 1000);
        }
        for (const [path, body] of [["/p", made.positions], ["/i", made.indices], ["/done", String(Math.min(...times))]]) {
            await fetch(path, { method: "POST", body });
        }`;
    const given = {
        "/page.html": `<!doctype html><script>new Worker("/worker.mjs", { type: "module" })</script>`,
        "/worker.mjs": worker,
        "/positions": bytes(positions),
        "/indices": bytes(indices),
    };
    const posted = await inBrowser(program, { folder: new URL(".", import.meta.url).pathname, given, page: "/page.html" });
    const array = (path, type) => new type(Uint8Array.from(posted.get(path)).buffer);
    return { positions: array("/p", Float32Array), indices: array("/i", Uint32Array), seconds: Number(posted.get("/done")) };
}

const program = inPage ? browser() : undefined;
if (inPage && !program) throw new Error("no browser on this machine; CHROMIUM=... names one");
const [positions, indices] = read(input);
console.log(`${indices.length / 3} triangles`);
for (const ratio of ratios.map(Number)) {
    for (const name of Object.keys(PEERS)) {
        const made = await (inPage ? inWorker : inNode)(name, positions, indices, ratio);
        write(`${folder}/${name}-${ratio}.ply`, made.positions, made.indices);
        const what = inPage ? "of a worker in a page" : "of CPU time";
        console.log(`${name} ${ratio}: ${made.indices.length / 3} triangles, ${made.seconds.toFixed(2)} s ${what}, least of ${RUNS}`);
    }
}
