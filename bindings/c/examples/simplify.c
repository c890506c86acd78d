/*
 * Simplifies a coloured, bumpy sphere in memory, measures the error, and with two arguments simplifies a file too:
 *
 *     cc examples/simplify.c $(pkg-config --cflags --libs stonecut) -lm -o simplify
 *     ./simplify [INPUT OUTPUT]
 */
#include <stonecut.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { ROWS = 150, COLUMNS = 300, N_VERTICES = ROWS * COLUMNS, N_TRIANGLES = 2 * (ROWS - 1) * COLUMNS };

static float positions[N_VERTICES][3];
static unsigned char colors[N_VERTICES][3];
static uint32_t triangles[N_TRIANGLES][3];

static void make_sphere(void) {
    int row, column, n = 0;
    for (row = 0; row < ROWS; row++) {
        for (column = 0; column < COLUMNS; column++) {
            const int v = row * COLUMNS + column;
            const double up = 0.05 + 3.04 * row / (ROWS - 1), around = 6.283185307179586 * column / COLUMNS;
            const double r = 1.0 + 0.05 * sin(9.0 * up) * cos(7.0 * around);
            positions[v][0] = (float)(r * sin(up) * cos(around));
            positions[v][1] = (float)(r * sin(up) * sin(around));
            positions[v][2] = (float)(r * cos(up));
            colors[v][0] = (unsigned char)(255 * row / (ROWS - 1));
            colors[v][1] = 128;
            colors[v][2] = (unsigned char)(127.5 + 127.4 * cos(around));
            if (row + 1 < ROWS) {
                const uint32_t a = (uint32_t)v, b = (uint32_t)(row * COLUMNS + (column + 1) % COLUMNS);
                const uint32_t quad[2][3] = {{a, a + COLUMNS, b}, {b, a + COLUMNS, b + COLUMNS}};
                int i;
                for (i = 0; i < 6; i++) {
                    triangles[n + i / 3][i % 3] = quad[i / 3][i % 3];
                }
                n += 2;
            }
        }
    }
}

static int show(const stonecut_progress *progress, void *user) {
    int *calls = (int *)user;
    ++*calls;
    fprintf(stderr, "%s %u/%u, %.0f %%\n", progress->stage, progress->number, progress->stages, 100.0 * progress->fraction);
    return 0; /* anything else stops the call */
}

/* What a code means; 0 if there is a result to go on with. */
static int failed(int code) {
    const stonecut_error *error = stonecut_last_error();
    if (code == STONECUT_OK) {
        return 0;
    }
    fprintf(stderr, "%s: %s%s%s\n", error->name, error->message, error->remedy[0] ? "; " : "", error->remedy);
    return code != STONECUT_SHORT;
}

int main(int argc, char **argv) {
    stonecut_attribute color;
    stonecut_mesh mesh;
    stonecut_options options;
    stonecut_result *small = NULL, *apart = NULL, *file = NULL;
    const stonecut_mesh *result;
    double rms = 0.0;
    int calls = 0;

    make_sphere();
    color.name = "color";
    color.values = colors;
    color.stride = 0; /* packed */
    color.type = STONECUT_U8;
    color.width = 3;

    stonecut_init(&mesh, sizeof mesh);
    mesh.positions = positions;
    mesh.position_type = STONECUT_F32;
    mesh.n_vertices = N_VERTICES;
    mesh.triangles = triangles[0];
    mesh.n_triangles = N_TRIANGLES;
    mesh.attributes = &color;
    mesh.n_attributes = 1;

    stonecut_init(&options, sizeof options);
    options.ratio = 0.02;
    options.progress = show;
    options.user = &calls;

    if (failed(stonecut_simplify(&mesh, &options, &small)) || (result = stonecut_result_mesh(small)) == NULL) {
        return EXIT_FAILURE;
    }
    options.samples = 100000;
    if (failed(stonecut_measure(&mesh, result, &options, &apart)) || failed(stonecut_result_number(apart, "/relative_rms", &rms))) {
        stonecut_result_free(small);
        return EXIT_FAILURE;
    }
    {
        const unsigned char *rgb = (const unsigned char *)result->attributes[0].values;
        const float *first = (const float *)result->positions;
        printf("stonecut %s: %lu of %lu triangles, error %.5f of the diagonal\n", stonecut_version(),
               (unsigned long)result->n_triangles, (unsigned long)mesh.n_triangles, rms);
        printf("first vertex (%.3f %.3f %.3f) is %u %u %u and was vertex %lu\n", first[0], first[1], first[2], rgb[0], rgb[1], rgb[2],
               (unsigned long)result->source[0]);
    }
    stonecut_result_free(apart);
    stonecut_result_free(small);

    if (argc == 3) {
        const char *words[] = {"simplify", NULL, NULL, "--ratio=10%", "--force"};
        double left = 0.0;
        words[1] = argv[1];
        words[2] = argv[2];
        stonecut_init(&options, sizeof options);
        options.progress = show;
        options.user = &calls;
        if (failed(stonecut_run(words, 5, &options, &file)) || failed(stonecut_result_number(file, "/output/triangles", &left))) {
            stonecut_result_free(file);
            return EXIT_FAILURE;
        }
        printf("%s has %.0f triangles\n", argv[2], left);
        stonecut_result_free(file);
    }
    return EXIT_SUCCESS;
}
