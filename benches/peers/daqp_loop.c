/* Times DAQP's C library on a block of windows: update and solve, window by window.
 *
 * min 1/2 |t|^2 subject to lower <= A t <= upper, A (m x n) fixed. The windows' bounds are rows of m numbers. Warm: the active
 * set of the last window is where the next one starts. */
#include "api.h"
#include "auxiliary.h"
#include "utils.h"
#include <string.h>
#include <time.h>

static long long now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

/* t (windows x n), exit flags and nanoseconds of each window; returns the flag of the set-up, negative if it failed. */
int daqp_block(int n, int m, double *A, int windows, double *lower, double *upper, int warm, double tolerance, double *t,
               int *flags, long long *nanoseconds) {
    DAQPProblem qp;
    DAQPWorkspace work;
    DAQPResult result;
    memset(&qp, 0, sizeof qp);
    memset(&work, 0, sizeof work);
    memset(&result, 0, sizeof result);
    double lam[m], x[n];
    int sense[m];
    memset(sense, 0, sizeof sense);
    qp.n = n;
    qp.m = m;
    qp.A = A;
    qp.bupper = upper;
    qp.blower = lower;
    qp.sense = sense;
    result.x = x;
    result.lam = lam;
    allocate_daqp_settings(&work);
    work.settings->primal_tol = tolerance;
    int flag = setup_daqp(&qp, &work, NULL);
    if (flag < 0) return flag;
    for (int k = 0; k < windows; k++) {
        long long start = now();
        qp.bupper = upper + (size_t)k * m;
        qp.blower = lower + (size_t)k * m;
        if (!warm) {
            daqp_deactivate_constraints(&work);
            reset_daqp_workspace(&work);
        }
        daqp_update_ldp(DAQP_UPDATE_d, &work, &qp);
        daqp_solve(&result, &work);
        nanoseconds[k] = now() - start;
        flags[k] = result.exitflag;
        memcpy(t + (size_t)k * n, x, sizeof x);
    }
    free_daqp_workspace(&work);
    free_daqp_ldp(&work);
    return 0;
}
