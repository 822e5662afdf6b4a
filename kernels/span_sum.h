// Sums over the degree + 1 functions of a knot span, written out for each degree: weights stay in registers then.

#define WEIGHT(a) (a <= degree ? values[(size_t)min(a, degree) * n_all] : 0)
#define SUM_1(w, term) (w##0 * term(0) + w##1 * term(1))
#define SUM_2(w, term) (SUM_1(w, term) + w##2 * term(2))
#define SUM_3(w, term) (SUM_2(w, term) + w##3 * term(3))
#define SUM_4(w, term) (SUM_3(w, term) + w##4 * term(4))
#define SUM_5(w, term) (SUM_4(w, term) + w##5 * term(5))

// What is added to the sums of a channel: those of x, y and z, the first three, are from an origin.
inline real origin_of(int channel, real x, real y, real z)
{
    return channel == 0 ? x : channel == 1 ? y : channel == 2 ? z : 0;
}

// Calls what is defined for each degree by its number.
#define FOR_DEGREE(call)       \
    switch (degree) {          \
    case 1: { call(1) } break; \
    case 2: { call(2) } break; \
    case 3: { call(3) } break; \
    case 4: { call(4) } break; \
    case 5: { call(5) } break; \
    }
