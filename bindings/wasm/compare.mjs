// Times this package beside npm's meshoptimizer, and writes both results for `stonecut measure`:
//
//     node compare.mjs IN.ply RATIO... [--out FOLDER]        (float PLY, little-endian, of triangles alone; npm i meshoptimizer before)
import { readFileSync, writeFileSync } from "node:fs";
import { simplify } from "./stonecut.mjs";

const words = process.argv.slice(2);
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

const [positions, indices] = read(input);
console.log(`${indices.length / 3} triangles`);
for (const ratio of ratios.map(Number)) {
    const peers = {
        stonecut: async () => simplify(positions, indices, { ratio }),
        meshoptimizer: async () => {
            const wanted = 3 * Math.floor((ratio * indices.length) / 3);
            const [left] = MeshoptSimplifier.simplify(indices, positions, 3, wanted, 1e9);
            return { positions, indices: left };
        },
    };
    for (const [name, run] of Object.entries(peers)) {
        const times = [];
        let made;
        for (let k = 0; k < 5; k++) {
            const begun = process.cpuUsage();
            made = await run();
            const { user, system } = process.cpuUsage(begun);
            times.push((user + system) / 1e6);
        }
        times.sort((a, b) => a - b);
        write(`${folder}/${name}-${ratio}.ply`, made.positions, made.indices);
        console.log(`${name} ${ratio}: ${made.indices.length / 3} triangles, ${times[0].toFixed(2)} s of CPU time, least of 5`);
    }
}
