/*
 * stonecut: simplifies triangle meshes of any size, in memory or out of core, and measures the error.
 *
 * Ten functions. docs/c.md of the repository has the recipes, examples/simplify.c a whole program.
 *
 * Structures that the caller fills begin with their size, so that they can grow: call stonecut_init() on them, then set what you
 * need. Zero and NULL mean "the default". Those that the library fills are read through pointers and may grow at their end.
 *
 * Every function may be called from several threads at once. Arrays and texts that are given must not be changed during the call;
 * the library keeps no pointer to them afterwards. A result may be read by several threads and freed by one.
 *
 * No function exits, aborts on purpose, catches signals or prints, but a fault of stonecut's own (STONECUT_INTERNAL) leaves a line on
 * standard error.
 */
#ifndef STONECUT_H
#define STONECUT_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What functions return: the exit codes of the command line (docs/usage.md). */
enum {
    STONECUT_OK = 0,
    STONECUT_FAILED = 1,         /* the system refused to read or write, or a temporary file is damaged */
    STONECUT_USAGE = 2,          /* arguments that make no sense */
    STONECUT_SHORT = 3,          /* done, but not all that was asked for: there is a result unless nothing would be left */
    STONECUT_BAD_INPUT = 4,      /* a mesh that holds what no mesh may hold: an index out of range, NaN */
    STONECUT_NO_SPACE = 5,       /* the file system is full */
    STONECUT_NO_MEMORY = 6,      /* the memory budget cannot hold the work */
    STONECUT_LOCKED = 7,         /* another run holds the job */
    STONECUT_STATE_MISMATCH = 8, /* the job folder belongs to another input or to other settings */
    STONECUT_INTERNAL = 9,       /* a fault of stonecut itself; please report it */
    STONECUT_DEVICE = 10,        /* the disk takes no files, or fails */
    STONECUT_STOPPED = 130       /* the progress function asked to stop */
};

/* Types of numbers in arrays. */
enum {
    STONECUT_I8 = 1,
    STONECUT_U8 = 2,
    STONECUT_I16 = 3,
    STONECUT_U16 = 4,
    STONECUT_I32 = 5,
    STONECUT_U32 = 6,
    STONECUT_I64 = 7,
    STONECUT_U64 = 8,
    STONECUT_F32 = 9,
    STONECUT_F64 = 10
};

/* A property of the vertices. This structure does not grow. */
typedef struct stonecut_attribute {
    /* "color" (3 or 4 of U8, U16, F32, F64), "normal" (3 of F32, F64), "uv" (2 of F32, F64) and "material" (1 I32, with "uv") are
     * known by name. Of all others, floats are averaged; integers are labels, taken from the vertex that survives. */
    const char *name;
    /* Numbers of the first vertex. */
    const void *values;
    /* Bytes from one vertex to the next; 0: packed. */
    size_t stride;
    /* STONECUT_U8, ... */
    uint32_t type;
    /* Numbers of a vertex. */
    uint32_t width;
} stonecut_attribute;

/* A mesh as arrays: given, or as a result. Arrays of a result are packed and live as long as it. */
typedef struct stonecut_mesh {
    size_t size; /* sizeof(stonecut_mesh): stonecut_init() sets it */
    /* x, y and z of each vertex, STONECUT_F32 or STONECUT_F64, all finite; of a result in the type that was given. */
    size_t n_vertices;
    const void *positions;
    size_t position_stride; /* bytes from one vertex to the next; 0: packed */
    uint32_t position_type;
    uint32_t reserved; /* 0 */
    /* Three corners of each triangle, counted from 0, counter-clockwise seen from outside. */
    size_t n_triangles;
    const uint32_t *triangles;
    /* A label of each triangle (a segment, a class), or NULL: borders between labels are kept. */
    const uint32_t *labels;
    /* Properties of the vertices. */
    size_t n_attributes;
    const stonecut_attribute *attributes;
    /* Of a result: the vertex of the input that survived as each vertex, in ascending order. */
    const uint32_t *source;
} stonecut_mesh;

/* State of a call. */
typedef struct stonecut_progress {
    const char *stage; /* partition, simplify, stitch, measure, ... */
    uint32_t number;   /* of the stage, from 1 */
    uint32_t stages;
    double fraction; /* of the call that is done, 0 to 1: an estimate that never falls */
    double seconds;  /* since it began */
    double seconds_left;
    uint64_t memory_bytes; /* resident memory of the process */
} stonecut_progress;

/* Called about ten times a second in the thread of the call, not at all in short ones. Not 0 stops the call, which then returns
 * STONECUT_STOPPED. C++: no exception may leave it. */
typedef int (*stonecut_progress_function)(const stonecut_progress *progress, void *user);

/* Options of a call; each means what it means on the command line. */
typedef struct stonecut_options {
    size_t size;           /* sizeof(stonecut_options): stonecut_init() sets it */
    uint64_t triangles;    /* --triangles: as many are left; 0: not given */
    double ratio;          /* --ratio: the share that is kept; 0: not given */
    uint64_t memory_bytes; /* --memory; 0: 75 % of what the process may take */
    size_t threads;        /* --threads; 0: the cores that it may use. No result depends on them */
    uint64_t samples;      /* --samples of a measurement; 0: a million */
    /* Any other options: {"--topology=keep", "--weight=color=2"}. */
    const char *const *words;
    size_t n_words;
    stonecut_progress_function progress; /* or NULL */
    void *user;                          /* handed to it */
} stonecut_options;

/* The last call of this thread that returned a code. Texts live until the next one. */
typedef struct stonecut_error {
    int code;
    const char *name;    /* "bad_input", ...: a name for the class (docs/usage.md); "" after STONECUT_OK */
    const char *message; /* one line: what was wrong, where, what to do */
    const char *remedy;  /* what helps beside that, or "" */
} stonecut_error;

/* Result of a call: a report, and of stonecut_simplify() a mesh. */
typedef struct stonecut_result stonecut_result;

/* Version of the library: "0.1.0". */
const char *stonecut_version(void);

/* Sets all `size` bytes of a structure to 0 and its first member, `size`: stonecut_init(&options, sizeof options). */
void stonecut_init(void *structure, size_t size);

/*
 * Simplifies a mesh in memory to options->triangles or options->ratio.
 *
 * The mesh and the bytes are those that `stonecut simplify` gives for up to a million triangles; beyond that it works through cells in
 * memory, in parallel. Memory beside the arrays: about 120 bytes a triangle up to a million, then about 40.
 *
 * After STONECUT_OK and STONECUT_SHORT, *result is to be freed; after all else it is NULL (of STONECUT_SHORT, too, if nothing would be
 * left).
 */
int stonecut_simplify(const stonecut_mesh *mesh, const stonecut_options *options, stonecut_result **result);

/* Measures how far two meshes in memory are apart, both ways. Of the options, which may be NULL, it reads samples, threads and progress.
 * Numbers of the result: "/rms", "/relative_rms", "/forward/max", "/backward/mean", ... (docs/report.md). */
int stonecut_measure(const stonecut_mesh *original, const stonecut_mesh *simplified, const stonecut_options *options,
                     stonecut_result **result);

/*
 * Runs a command from file to file, of any size: {"simplify", "scan.ply", "small.ply", "--ratio=1%"}, or measure, tiles, extract,
 * info, convert, compare, render, synth. Options that are not 0 are added to the words; options may be NULL.
 *
 * Interrupted runs of simplify continue when the same words are given again. A path that begins with a dash needs "./" before it.
 */
int stonecut_run(const char *const *words, size_t n_words, const stonecut_options *options, stonecut_result **result);

/* How the last call of this thread ended; never NULL. */
const stonecut_error *stonecut_last_error(void);

/* The mesh of a result of stonecut_simplify(); NULL of all others. */
const stonecut_mesh *stonecut_result_mesh(const stonecut_result *result);

/* The report as JSON (docs/report.md). */
const char *stonecut_result_report(const stonecut_result *result);

/* A number of the report by its JSON pointer: "/output/triangles", "/target_met" (0 or 1). STONECUT_USAGE if there is none. */
int stonecut_result_number(const stonecut_result *result, const char *pointer, double *number);

/* Frees a result and everything that was read from it; NULL is allowed. */
void stonecut_result_free(stonecut_result *result);

#ifdef __cplusplus
}
#endif

#endif
