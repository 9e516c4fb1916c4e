/* Times a whole estimator in C around DAQP's library, step by step: what a careful user would write.
 *
 * A step takes a new output y into the moving window, makes z* = z_0 + K [x_bar; y] and the window
 * c + A z* of it, the bounds of min 1/2 |t|^2, lower <= A t <= upper, updates and solves, and hands
 * out the window, v = y - y_hat and the cost. All numbers are in the user's units, so that nothing
 * is scaled on the way. Matrices lie in blocks of eight rows, column after column, so that a product
 * is made of whole vectors: of five ways to write its loop, what is below was the fastest. */
#include "api.h"
#include "auxiliary.h"
#include "utils.h"
#include <string.h>
#include <time.h>

enum { WIDTH = 8 };
typedef double Vector __attribute__((vector_size(WIDTH * sizeof(double)), aligned(8)));

typedef struct {
    int n, p, depth, rank, warm;
    const double *A;             /* rows x rank, by rows: DAQP's */
    const double *K_block;       /* rank x (n + depth p), in blocks */
    const double *A_block;       /* rows x rank, in blocks; rows: all states, then all outputs */
    const double *z_0, *c;       /* whole blocks */
    const double *lower, *upper; /* of the states, and of v (rows) */
    double prior_weight;
    const double *weight;        /* of v^2 (depth p) */
    double tolerance;
} Estimator;

static long long now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

static int blocks(int rows) { return (rows + WIDTH - 1) / WIDTH; }

/* out = start + M x: a block of rows at a time, in four sums that need not wait for each other */
static void product(int rows, int columns, const double *restrict M, const double *restrict start,
                    const double *restrict x, double *restrict out) {
    for (int b = 0; b < blocks(rows); b++) {
        Vector sums[4] = {*(const Vector *)(start + b * WIDTH)};
        int j = 0;
        for (; j + 4 <= columns; j += 4)
            for (int k = 0; k < 4; k++, M += WIDTH) sums[k] += *(const Vector *)M * x[j + k];
        for (; j < columns; j++, M += WIDTH) sums[0] += *(const Vector *)M * x[j];
        *(Vector *)(out + b * WIDTH) = (sums[0] + sums[1]) + (sums[2] + sums[3]);
    }
}

/* The data of a window, [x_bar; y] in one piece, and the states of its past. */
typedef struct {
    double *f, *past;
} Memory;

static void take_in(const Estimator *e, Memory *m, const double *y) {
    int n = e->n, p = e->p, depth = e->depth;
    memcpy(m->f, m->past, n * sizeof(double));
    memmove(m->f + n, m->f + n + p, (depth - 1) * p * sizeof(double));
    memcpy(m->f + n + (depth - 1) * p, y, p * sizeof(double));
}

static void hand_on(const Estimator *e, Memory *m, const double *x) {
    int n = e->n, depth = e->depth;
    memmove(m->past, m->past + n, (depth - 1) * n * sizeof(double));
    memcpy(m->past + (depth - 1) * n, x, n * sizeof(double));
}

static double cost(const Estimator *e, const double *f, const double *w, double *v) {
    int n = e->n, states = (e->depth + 1) * n, outputs = e->depth * e->p;
    double prior = 0.0, sums[WIDTH] = {0.0};
    for (int i = 0; i < n; i++) prior += (w[i] - f[i]) * (w[i] - f[i]);
    for (int i = 0; i < outputs; i++) v[i] = f[n + i] - w[states + i];
    int whole = outputs - outputs % WIDTH;
    for (int k = 0; k < whole; k += WIDTH)
        for (int i = 0; i < WIDTH; i++) sums[i] += e->weight[k + i] * v[k + i] * v[k + i];
    for (int k = whole; k < outputs; k++) sums[0] += e->weight[k] * v[k] * v[k];
    double noise = 0.0;
    for (int i = 0; i < WIDTH; i++) noise += sums[i];
    return e->prior_weight * prior + noise;
}

/* Steps over `count` outputs that follow the window (past states, outputs) at the start. Of each
 * step: its window (rows), v, cost, exit flag and nanoseconds. Negative if the set-up failed. */
int daqp_steps(const Estimator *e, const double *past, const double *outputs, int count,
               const double *ys, double *windows, double *vs, double *costs, int *flags,
               long long *nanoseconds) {
    int n = e->n, p = e->p, states = (e->depth + 1) * n, rows = states + e->depth * p;
    size_t room = (size_t)blocks(rows) * WIDTH, rank = (size_t)blocks(e->rank) * WIDTH;
    double f[n + e->depth * p], before[e->depth * n];
    double z[rank], t[rank], free_window[room], w[room], lower[room], upper[room], lam[room];
    int sense[rows];
    Memory memory = {f, before};
    memcpy(before, past, sizeof before);
    memcpy(f + n, outputs, e->depth * p * sizeof(double));
    memset(sense, 0, sizeof sense);

    DAQPProblem qp;
    DAQPWorkspace work;
    DAQPResult result;
    memset(&qp, 0, sizeof qp);
    memset(&work, 0, sizeof work);
    memset(&result, 0, sizeof result);
    memset(t, 0, sizeof t);
    for (int i = 0; i < rows; i++) lower[i] = -1e9, upper[i] = 1e9;
    qp.n = e->rank;
    qp.m = rows;
    qp.A = (double *)e->A;
    qp.bupper = upper;
    qp.blower = lower;
    qp.sense = sense;
    result.x = t;
    result.lam = lam;
    allocate_daqp_settings(&work);
    work.settings->primal_tol = e->tolerance;
    int flag = setup_daqp(&qp, &work, NULL);
    if (flag < 0) return flag;

    for (int k = 0; k < count; k++) {
        long long start = now();
        take_in(e, &memory, ys + (size_t)k * p);
        product(e->rank, n + e->depth * p, e->K_block, e->z_0, f, z);
        product(rows, e->rank, e->A_block, e->c, z, free_window);
        for (int i = 0; i < states; i++) {
            lower[i] = e->lower[i] - free_window[i];
            upper[i] = e->upper[i] - free_window[i];
        }
        for (int i = states; i < rows; i++) {
            double v = f[n + i - states] - free_window[i];
            lower[i] = v - e->upper[i];
            upper[i] = v - e->lower[i];
        }
        if (!e->warm) {
            daqp_deactivate_constraints(&work);
            reset_daqp_workspace(&work);
        }
        daqp_update_ldp(DAQP_UPDATE_d, &work, &qp);
        daqp_solve(&result, &work);
        const double *found = free_window;
        if (work.n_active > 0) {
            product(rows, e->rank, e->A_block, free_window, t, w);
            found = w;
        }
        memcpy(windows + (size_t)k * rows, found, rows * sizeof(double));
        costs[k] = cost(e, f, found, vs + (size_t)k * e->depth * p);
        hand_on(e, &memory, found + states - n);
        nanoseconds[k] = now() - start;
        flags[k] = result.exitflag;
    }
    free_daqp_workspace(&work);
    free_daqp_ldp(&work);
    return 0;
}
