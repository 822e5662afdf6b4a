// B-spline basis functions by the recurrence of Cox and de Boor, and their derivatives.
// Source: Piegl and Tiller, The NURBS Book, 2nd ed., sections 2.2 to 2.3.

#define MAX_DEGREE 5

// Index s of the knot span with knots[s] <= t < knots[s + 1], the last non-empty span at the end of the domain.
inline int knot_span(__global const real *knots, int degree, int n_control, real t)
{
    int low = degree, high = n_control;
    while (high - low > 1) {
        int middle = (low + high) / 2;
        if (t < knots[middle])
            high = middle;
        else
            low = middle;
    }
    while (low > degree && knots[low] == knots[low + 1])
        low--;
    return low;
}

// The derivatives, of an order, of the degree + 1 basis functions that live at each parameter of each direction.
//
// given: the knots of u, v and w one after another, then their parameters, `out_u` and so on, n in all. span: (n,);
// values: (degree + 1, n) planes; function span - degree + a is plane a.
__kernel void basis_functions(__global const real *given, int degree_u, int n_u, int out_u, int order_u, int degree_v,
                              int n_v, int out_v, int order_v, int degree_w, int n_w, int out_w, int order_w,
                              __global int *span, __global real *values)
{
    int i = get_global_id(0), n = out_u + out_v + out_w;
    if (i >= n)
        return;
    int degree = degree_u, n_control = n_u, order = order_u;
    __global const real *knots = given;
    if (i >= out_u)
        knots += n_u + degree_u + 1, degree = degree_v, n_control = n_v, order = order_v;
    if (i >= out_u + out_v)
        knots += n_v + degree_v + 1, degree = degree_w, n_control = n_w, order = order_w;
    real t = given[n_u + degree_u + n_v + degree_v + n_w + degree_w + 3 + i];
    int s = knot_span(knots, degree, n_control, t);
    real N[MAX_DEGREE + 1];
    for (int a = 0; a <= MAX_DEGREE; a++)
        N[a] = 0;
    if (order <= degree)
        N[0] = 1;
    for (int d = 1; d <= degree - order; d++) {
        real saved = 0;
        for (int a = 0; a < d; a++) {
            real right = knots[s + a + 1] - t, left = t - knots[s + a + 1 - d];
            real share = N[a] / (right + left);
            N[a] = saved + right * share;
            saved = left * share;
        }
        N[d] = saved;
    }
    for (int d = max(degree - order, 0) + 1; d <= degree; d++) {
        for (int a = d; a >= 0; a--) {
            real slope = 0;
            if (a > 0)
                slope += N[a - 1] / (knots[s + a] - knots[s + a - d]);
            if (a < d)
                slope -= N[a] / (knots[s + a + 1] - knots[s + a + 1 - d]);
            N[a] = d * slope;
        }
    }
    span[i] = s;
    for (int a = 0; a <= degree; a++)
        values[(size_t)a * n + i] = N[a];
}
