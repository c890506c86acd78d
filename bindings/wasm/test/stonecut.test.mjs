import assert from "node:assert/strict";
import { test } from "node:test";
import { simplify } from "../stonecut.mjs";

/// A sphere of 4 n² quads, closed.
function sphere(n) {
    const positions = [], indices = [], number = new Map();
    const at = (p) => {
        const key = p.join();
        if (!number.has(key)) {
            number.set(key, positions.length / 3);
            const length = Math.hypot(...p);
            positions.push(...p.map((x) => x / length));
        }
        return number.get(key);
    };
    for (const axis of [0, 1, 2]) {
        for (const side of [-n, n]) {
            for (let i = -n; i < n; i += 2) {
                for (let j = -n; j < n; j += 2) {
                    const corner = (a, b) => {
                        const p = [0, 0, 0];
                        [p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]] = [side, a, b];
                        return at(p);
                    };
                    const q = [corner(i, j), corner(i + 2, j), corner(i + 2, j + 2), corner(i, j + 2)];
                    if (side < 0) q.reverse();
                    indices.push(q[0], q[1], q[2], q[0], q[2], q[3]);
                }
            }
        }
    }
    return [new Float32Array(positions), new Uint32Array(indices)];
}

/// True if every edge has two triangles, one each way.
function isClosed(indices) {
    const edges = new Map();
    for (let i = 0; i < indices.length; i += 3) {
        for (const [a, b] of [[0, 1], [1, 2], [2, 0]]) edges.set(`${indices[i + a]},${indices[i + b]}`, true);
    }
    return edges.size === indices.length && [...edges.keys()].every((edge) => edges.has(edge.split(",").reverse().join()));
}

test("a sphere becomes a smaller sphere, the same every time", async () => {
    const [positions, indices] = sphere(24);
    const given = indices.slice();
    const made = await simplify(positions, indices, { ratio: 0.1 });
    assert.deepEqual(indices, given);
    assert.ok(made.positions instanceof Float32Array && made.indices instanceof Uint32Array);
    assert.ok(made.indices.length / 3 <= indices.length / 30 && made.indices.length / 3 >= indices.length / 30 - 2);
    assert.ok(isClosed(made.indices));
    for (let i = 0; i < made.positions.length; i += 3) {
        assert.ok(Math.abs(Math.hypot(...made.positions.subarray(i, i + 3)) - 1) < 0.01);
    }
    const again = await simplify(new Float64Array(positions), [...indices], { triangles: Math.floor(indices.length / 30) });
    assert.ok(again.positions instanceof Float64Array);
    assert.deepEqual(again.indices, made.indices);
});

test("the map leads each vertex to one near it, and subset keeps places", async () => {
    const [positions, indices] = sphere(16);
    const made = await simplify(positions, indices, { ratio: 0.25, placement: "subset", map: true });
    const places = new Set();
    for (let v = 0; v < positions.length; v += 3) places.add(positions.subarray(v, v + 3).join());
    for (let v = 0; v < made.positions.length; v += 3) assert.ok(places.has(made.positions.subarray(v, v + 3).join()));
    assert.equal(made.map.length, positions.length / 3);
    made.map.forEach((to, from) => {
        const away = [0, 1, 2].map((k) => positions[3 * from + k] - made.positions[3 * to + k]);
        assert.ok(Math.hypot(...away) < 0.4);
    });
});

test("boundaries stay where that was asked for, and what is wrong is said", async () => {
    const [positions, indices] = sphere(12);
    const open = indices.subarray(0, indices.length / 3);
    const made = await simplify(positions, open, { ratio: 0.3, lockBoundary: true });
    assert.ok(made.indices.length > 0 && made.indices.length < open.length);
    const wrong = indices.slice();
    wrong[7] = 1e6;
    const nan = positions.slice();
    nan[5] = NaN;
    await assert.rejects(simplify(positions, wrong, { ratio: 0.5 }), /below the/);
    await assert.rejects(simplify(nan, indices, { ratio: 0.5 }), /not finite/);
    await assert.rejects(simplify(positions, indices, {}), /triangles or ratio/);
    await assert.rejects(simplify(positions, indices, { ratio: 2 }), /out of range/);
    await assert.rejects(simplify(positions, indices, { ratio: 0.5, lockBorder: true }), /lockBorder/);
    await assert.rejects(simplify([...positions], indices, { ratio: 0.5 }), /Float32Array/);
    // It goes on after all that.
    assert.equal((await simplify(positions, indices, { ratio: 1 })).indices.length, indices.length);
});
