// Simplifies off the page's thread: answers { id, positions, indices, options } with the result, arrays moved, not copied.
import { simplify } from "../stonecut.mjs";

self.onmessage = async ({ data: { id, positions, indices, options } }) => {
    try {
        const made = await simplify(positions, indices, options);
        self.postMessage({ id, ...made }, [made.positions.buffer, made.indices.buffer]);
    } catch (error) {
        self.postMessage({ id, error: error.message });
    }
};
