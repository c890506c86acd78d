export interface Options {
    /** Triangles wanted, at most. */
    triangles?: number;
    /** Share of the triangles that is kept, above 0 and at most 1; instead of `triangles`. */
    ratio?: number;
    /** Place of vertices that survive: of least error, or only places of the input. */
    placement?: "optimal" | "subset";
    /** Fate of components, holes and handles smaller than the error. */
    topology?: "error" | "keep";
    /** Vertices at open edges stay where they are. */
    lockBoundary?: boolean;
    /** Moves vertices to fit the original; without it only where about 1 % of the triangles are left. */
    fit?: boolean;
    /** Gives `map`, too. */
    map?: boolean;
}

export interface Simplified<T> {
    positions: T;
    indices: Uint32Array;
    /** For each vertex of the input the vertex of the result that it became, or 0xffffffff. */
    map?: Uint32Array;
}

export function load(source?: URL | BufferSource | Response | Promise<Response> | WebAssembly.Module): Promise<void>;
export function simplify<T extends Float32Array | Float64Array>(
    positions: T,
    indices: ArrayLike<number>,
    options: Options,
): Promise<Simplified<T>>;
