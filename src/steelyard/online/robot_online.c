#include <math.h>
#include <stdbool.h>
#include <stddef.h>

#if defined(__FAST_MATH__) || defined(_M_FP_FAST) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0)) || \
    defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__)
#error "Compile without -ffast-math and its parts: they remove the tests for what is no number, and the digits of pairs."
#endif
#if FLT_EVAL_METHOD == 2
#error "Compile for SSE2 (-msse2 -mfpmath=sse): registers of 80 bits lose the digits of pairs."
#endif

/*TABLES*/

/* ---------------------------------------------------------------------------------------------
 * Dense symmetric matrices of the conditions. They are small: no condition has more than
 * ROBOT_ONLINE_LARGEST rows. All are stored row by row.
 * ------------------------------------------------------------------------------------------- */

/* A lower bound, close by, of the smallest eigenvalue of a symmetric matrix, which is overwritten:
 * Householder's reflections make it tridiagonal, and Newton's method climbs from below, where the
 * characteristic polynomial is convex, so that it never passes the eigenvalue. */
static double smallest_eigenvalue(int32_t size, double *matrix)
{
    double diagonal[ROBOT_ONLINE_LARGEST];
    double squares[ROBOT_ONLINE_LARGEST]; /* of the elements beside the diagonal */
    double vector[ROBOT_ONLINE_LARGEST];
    double product[ROBOT_ONLINE_LARGEST];
    for (int32_t k = 0; k < (size - 2); ++k) {
        double rest = 0.0;
        for (int32_t i = k + 2; i < size; ++i) {
            rest += matrix[(i * size) + k] * matrix[(i * size) + k];
        }
        const double first = matrix[((k + 1) * size) + k];
        squares[k] = (first * first) + rest;
        diagonal[k] = matrix[(k * size) + k];
        if (rest > DBL_MIN) { /* of what is smaller the inverse would overflow */
            const double length = (first > 0.0) ? -sqrt(squares[k]) : sqrt(squares[k]);
            const double factor = 1.0 / (squares[k] - (first * length));
            vector[k + 1] = first - length;
            for (int32_t i = k + 2; i < size; ++i) {
                vector[i] = matrix[(i * size) + k];
            }
            double sum = 0.0;
            for (int32_t i = k + 1; i < size; ++i) {
                double dot = 0.0;
                for (int32_t j = k + 1; j < size; ++j) {
                    dot += matrix[(i * size) + j] * vector[j];
                }
                product[i] = dot * factor;
                sum += product[i] * vector[i];
            }
            sum *= 0.5 * factor;
            for (int32_t i = k + 1; i < size; ++i) {
                product[i] -= sum * vector[i];
            }
            for (int32_t i = k + 1; i < size; ++i) {
                for (int32_t j = k + 1; j < size; ++j) {
                    matrix[(i * size) + j] -= (vector[i] * product[j]) + (product[i] * vector[j]);
                }
            }
        }
    }
    if (size > 1) {
        const double last = matrix[((size - 1) * size) + (size - 2)];
        squares[size - 2] = last * last;
        diagonal[size - 2] = matrix[((size - 2) * size) + (size - 2)];
    }
    diagonal[size - 1] = matrix[(size * size) - 1];
    squares[size - 1] = 0.0;

    /* Gershgorin's discs hold all eigenvalues. */
    double bound = 0.0;
    double spread = 0.0;
    double before = 0.0;
    for (int32_t k = 0; k < size; ++k) {
        const double after = sqrt(squares[k]);
        const double low = diagonal[k] - before - after;
        if ((k == 0) || (low < bound)) {
            bound = low;
        }
        spread = fmax(spread, fabs(diagonal[k]) + before + after);
        before = after;
    }
    for (int32_t step = 0; step < ROBOT_ONLINE_EIGENVALUE_STEPS; ++step) {
        /* Ratios of neighbouring minors and their derivatives: no overflow. */
        double ratio = diagonal[0] - bound;
        double slope = -1.0;
        double sum = 0.0;
        bool above = (ratio > 0.0); /* nothing is divided by zero, which some controllers trap */
        for (int32_t k = 1; (k < size) && above; ++k) {
            const double quotient = squares[k - 1] / ratio;
            sum += slope / ratio;
            slope = ((quotient * slope) / ratio) - 1.0;
            ratio = (diagonal[k] - bound) - quotient;
            above = (ratio > 0.0);
        }
        if (above) {
            sum += slope / ratio;
        }
        if (!above) {
            bound -= 1e-15 * spread; /* rounding at the eigenvalue itself */
            break;
        }
        const double increase = -1.0 / sum;
        bound += increase;
        if (increase <= (1e-3 * fabs(bound))) {
            break;
        }
    }
    return bound;
}

/* ---------------------------------------------------------------------------------------------
 * The Newton system: a sparse matrix whose factor has the same places in every step.
 * ------------------------------------------------------------------------------------------- */

/* Pairs of numbers, whose sum has twice the digits (T. J. Dekker, A floating-point technique for
 * extending the available precision, Numerische Mathematik 18, 1971). Near the boundary the Newton
 * matrix needs them: its largest elements are 1e20 times those that decide how heavy a link is. */

static robot_online_pair pair_of(double value)
{
    robot_online_pair result;
    result.high = value;
    result.low = 0.0;
    return result;
}

static double rounded_pair(robot_online_pair value)
{
    return value.high + value.low;
}

static robot_online_pair pair_product(double first, double second)
{
    robot_online_pair product;
    product.high = first * second;
#if defined(FP_FAST_FMA) || defined(__FP_FAST_FMA) /* the processor rounds the sum of a product and a number once */
    product.low = fma(first, second, -product.high);
#else
    const double split = 134217729.0; /* 2^27 + 1 */
    const double first_scaled = split * first;
    const double first_high = first_scaled - (first_scaled - first);
    const double first_low = first - first_high;
    const double second_scaled = split * second;
    const double second_high = second_scaled - (second_scaled - second);
    const double second_low = second - second_high;
    product.low = (((first_high * second_high) - product.high) + (first_high * second_low) +
                   (first_low * second_high)) +
                  (first_low * second_low);
#endif
    return product;
}

static robot_online_pair pair_times(robot_online_pair first, robot_online_pair second)
{
    robot_online_pair product = pair_product(first.high, second.high);
    product.low += (first.high * second.low) + (first.low * second.high);
    return product;
}

static robot_online_pair negative_pair(robot_online_pair value)
{
    robot_online_pair result;
    result.high = -value.high;
    result.low = -value.low;
    return result;
}

static void add_pair(robot_online_pair *sum, robot_online_pair value)
{
    const double high = sum->high + value.high;
    const double part = high - sum->high;
    const double error = (sum->high - (high - part)) + (value.high - part);
    const double low = error + (sum->low + value.low);
    sum->high = high + low;
    sum->low = low - (sum->high - high);
}

/* 1 / sqrt(pivot). A pivot that rounding made negative stands for a direction that nothing
 * determines: the step leaves it alone. */
static robot_online_pair inverse_root_of_pair(robot_online_pair pivot, robot_online_pair diagonal)
{
    const double least = ROBOT_ONLINE_ROUNDING * ROBOT_ONLINE_ROUNDING * diagonal.high;
    robot_online_pair inverse = pair_of(1.0 / ROBOT_ONLINE_BLOCKED);
    if (pivot.high > least) {
        /* Newton's step for 1 / sqrt(pivot): x + x (1 - pivot x^2) / 2. */
        const double guess = 1.0 / sqrt(pivot.high);
        robot_online_pair error = pair_of(1.0);
        add_pair(&error, negative_pair(pair_times(pivot, pair_product(guess, guess))));
        inverse = pair_of(guess);
        add_pair(&inverse, pair_of(0.5 * guess * error.high));
    }
    return inverse;
}

/* The same of single numbers. */

static double double_of(double value)
{
    return value;
}

static double rounded_double(double value)
{
    return value;
}

static double double_product(double first, double second)
{
    return first * second;
}

static double double_times(double first, double second)
{
    return first * second;
}

static double negative_double(double value)
{
    return -value;
}

static void add_double(double *sum, double value)
{
    *sum += value;
}

static double inverse_root_of_double(double pivot, double diagonal)
{
    const double least = ROBOT_ONLINE_ROUNDING * diagonal;
    return 1.0 / ((pivot > least) ? sqrt(pivot) : ROBOT_ONLINE_BLOCKED);
}

/*TWICE*/
/* In pairs: the Cholesky factor of a matrix, in the lower triangle, with the inverses of its
 * elements on the diagonal; false where the matrix is not definite. */
static bool cholesky_in_pairs(int32_t size, const double *matrix, robot_online_pair *factor)
{
    bool definite = true;
    for (int32_t j = 0; (j < size) && definite; ++j) {
        robot_online_pair pivot = pair_of(matrix[(j * size) + j]);
        for (int32_t k = 0; k < j; ++k) {
            const robot_online_pair value = factor[(j * size) + k];
            add_pair(&pivot, negative_pair(pair_times(value, value)));
        }
        /* Also false for what is not a number. */
        definite = rounded_pair(pivot) > 0.0;
        if (definite) {
            const robot_online_pair inverse = inverse_root_of_pair(pivot, pair_of(0.0));
            factor[(j * size) + j] = inverse;
            for (int32_t i = j + 1; i < size; ++i) {
                robot_online_pair sum = pair_of(matrix[(i * size) + j]);
                for (int32_t k = 0; k < j; ++k) {
                    add_pair(&sum, negative_pair(pair_times(factor[(i * size) + k],
                                                            factor[(j * size) + k])));
                }
                factor[(i * size) + j] = pair_times(sum, inverse);
            }
        }
    }
    return definite;
}

/* The inverse of a lower triangular matrix, in the lower triangle. */
static void inverse_of_triangle_in_pairs(int32_t size, const robot_online_pair *factor,
                                         double *inverse)
{
    robot_online_pair column[ROBOT_ONLINE_LARGEST];
    for (int32_t j = 0; j < size; ++j) {
        column[j] = factor[(j * size) + j];
        inverse[(j * size) + j] = rounded_pair(column[j]);
        for (int32_t i = j + 1; i < size; ++i) {
            robot_online_pair sum = pair_of(0.0);
            for (int32_t k = j; k < i; ++k) {
                add_pair(&sum, negative_pair(pair_times(factor[(i * size) + k], column[k])));
            }
            column[i] = pair_times(sum, factor[(i * size) + i]);
            inverse[(i * size) + j] = rounded_pair(column[i]);
        }
    }
}

/* The inverse of L L' from that of L. */
static void inverse_of_product_in_pairs(int32_t size, const double *inverse, double *product)
{
    for (int32_t i = 0; i < size; ++i) {
        for (int32_t j = 0; j <= i; ++j) {
            robot_online_pair sum = pair_of(0.0);
            for (int32_t k = i; k < size; ++k) {
                add_pair(&sum, pair_product(inverse[(k * size) + i], inverse[(k * size) + j]));
            }
            product[(i * size) + j] = rounded_pair(sum);
            product[(j * size) + i] = rounded_pair(sum);
        }
    }
}

/* The inverse Cholesky factors of matrices; false where one is not positive definite. */
static bool invert_matrices_in_pairs(const double *matrices, double *roots)
{
    bool inside = true;
    for (int32_t b = 0; (b < ROBOT_ONLINE_MATRICES) && inside; ++b) {
        const int32_t at = matrix_place[b];
        robot_online_pair factor[ROBOT_ONLINE_LARGEST * ROBOT_ONLINE_LARGEST];
        inside = cholesky_in_pairs(matrix_size[b], &matrices[at], factor);
        if (inside) {
            inverse_of_triangle_in_pairs(matrix_size[b], factor, &roots[at]);
        }
    }
    return inside;
}

/* The inverses of the conditions from those of their Cholesky factors. */
static void invert_roots_in_pairs(const double *roots, double *inverses)
{
    for (int32_t b = 0; b < ROBOT_ONLINE_MATRICES; ++b) {
        const int32_t at = matrix_place[b];
        inverse_of_product_in_pairs(matrix_size[b], &roots[at], &inverses[at]);
    }
}

/* The values of the conditions at the unknowns y, scalars first, then matrices; constants count
 * `constant` times, the margin is subtracted. */
static void conditions_in_pairs(const double *unknowns, double constant, double margin,
                                double *scalars, double *matrices)
{
    for (int32_t b = 0; b < ROBOT_ONLINE_SCALARS; ++b) {
        robot_online_pair sum = pair_product(scalar_constant[b], constant);
        add_pair(&sum, pair_of(-margin));
        for (int32_t k = scalar_start[b]; k < scalar_start[b + 1]; ++k) {
            add_pair(&sum, pair_product(scalar_value[k], unknowns[scalar_variable[k]]));
        }
        scalars[b] = rounded_pair(sum);
    }
    for (int32_t b = 0; b < ROBOT_ONLINE_MATRICES; ++b) {
        const int32_t size = matrix_size[b];
        robot_online_pair matrix[ROBOT_ONLINE_LARGEST * ROBOT_ONLINE_LARGEST];
        for (int32_t i = 0; i < (size * size); ++i) {
            matrix[i] = pair_product(matrix_constant[matrix_place[b] + i], constant);
        }
        for (int32_t i = 0; i < size; ++i) {
            add_pair(&matrix[(i * size) + i], pair_of(-margin));
        }
        for (int32_t v = matrix_start[b]; v < matrix_start[b + 1]; ++v) {
            const double value = unknowns[matrix_variable[v]];
            for (int32_t e = element_start[v]; e < element_start[v + 1]; ++e) {
                const robot_online_pair product = pair_product(element_value[e], value);
                add_pair(&matrix[element_place[e]], product);
                if (element_place[e] != element_mirror[e]) {
                    add_pair(&matrix[element_mirror[e]], product);
                }
            }
        }
        for (int32_t i = 0; i < (size * size); ++i) {
            matrices[matrix_place[b] + i] = rounded_pair(matrix[i]);
        }
    }
}

/* Add the products of the coefficients with matrices, by unknown. */
static void add_adjoint_in_pairs(const double *scalars, const double *matrices,
                                 robot_online_pair *sums)
{
    for (int32_t b = 0; b < ROBOT_ONLINE_SCALARS; ++b) {
        for (int32_t k = scalar_start[b]; k < scalar_start[b + 1]; ++k) {
            add_pair(&sums[scalar_variable[k]], pair_product(scalar_value[k], scalars[b]));
        }
    }
    for (int32_t b = 0; b < ROBOT_ONLINE_MATRICES; ++b) {
        const double *matrix = &matrices[matrix_place[b]];
        for (int32_t v = matrix_start[b]; v < matrix_start[b + 1]; ++v) {
            robot_online_pair *sum = &sums[matrix_variable[v]];
            for (int32_t e = element_start[v]; e < element_start[v + 1]; ++e) {
                add_pair(sum, pair_product(element_value[e], matrix[element_place[e]]));
                if (element_place[e] != element_mirror[e]) {
                    add_pair(sum, pair_product(element_value[e], matrix[element_mirror[e]]));
                }
            }
        }
    }
}

/* What is left of the dual equation: the products of the coefficients with the multipliers, with
 * their steps, or with both, less the gradient of the objective (curvature times unknowns plus the
 * linear part). */
static void balance_in_pairs(const structure *known, robot_online_workspace *work,
                             const double *unknowns, bool multipliers, bool steps, double *rest)
{
    robot_online_pair *sums = work->column_pairs;
    for (int32_t j = 0; j < ROBOT_ONLINE_VARIABLES; ++j) {
        sums[j] = pair_of(-work->linear[j]);
    }
    for (int32_t j = 0; j < ROBOT_ONLINE_VARIABLES; ++j) {
        const int32_t column = known->order[j];
        const int32_t start = known->column_start[j];
        add_pair(&sums[column], pair_product(-work->curvature[start], unknowns[column]));
        for (int32_t p = start + 1; p < known->column_start[j + 1]; ++p) {
            const double value = -work->curvature[p];
            if (value != 0.0) {
                const int32_t row = known->order[known->row[p]];
                add_pair(&sums[row], pair_product(value, unknowns[column]));
                add_pair(&sums[column], pair_product(value, unknowns[row]));
            }
        }
    }
    if (multipliers) {
        add_adjoint_in_pairs(work->scalar_multipliers, work->multipliers, sums);
    }
    if (steps) {
        add_adjoint_in_pairs(work->scalar_multiplier_steps, work->multiplier_steps, sums);
    }
    for (int32_t j = 0; j < ROBOT_ONLINE_VARIABLES; ++j) {
        rest[j] = rounded_pair(sums[j]);
    }
}

/* Subtract sym(Z dS S^-1) from the steps of the multipliers: what steps of the conditions bring. */
static void add_response_in_pairs(robot_online_workspace *work, const double *scalar_steps,
                                  const double *steps)
{
    for (int32_t b = 0; b < ROBOT_ONLINE_SCALARS; ++b) {
        work->scalar_multiplier_steps[b] -=
            (work->scalar_multipliers[b] * scalar_steps[b]) / work->scalars[b];
    }
    for (int32_t b = 0; b < ROBOT_ONLINE_MATRICES; ++b) {
        const int32_t size = matrix_size[b];
        const int32_t at = matrix_place[b];
        const double *z = &work->multipliers[at];
        const double *s = &work->inverses[at];
        robot_online_pair product[ROBOT_ONLINE_LARGEST * ROBOT_ONLINE_LARGEST];
        for (int32_t i = 0; i < size; ++i) {
            robot_online_pair row[ROBOT_ONLINE_LARGEST];
            for (int32_t j = 0; j < size; ++j) {
                row[j] = pair_of(0.0);
                for (int32_t k = 0; k < size; ++k) {
                    add_pair(&row[j], pair_product(z[(i * size) + k], steps[at + (k * size) + j]));
                }
            }
            for (int32_t j = 0; j < size; ++j) {
                robot_online_pair sum = pair_of(0.0);
                for (int32_t k = 0; k < size; ++k) {
                    add_pair(&sum, pair_times(row[k], pair_of(s[(k * size) + j])));
                }
                product[(i * size) + j] = sum;
            }
        }
        for (int32_t i = 0; i < size; ++i) {
            for (int32_t j = 0; j <= i; ++j) {
                robot_online_pair sum = product[(i * size) + j];
                add_pair(&sum, product[(j * size) + i]);
                const double half = 0.5 * rounded_pair(sum);
                work->multiplier_steps[at + (i * size) + j] -= half;
                if (i != j) {
                    work->multiplier_steps[at + (j * size) + i] -= half;
                }
            }
        }
    }
}

/* (target - correction) S^-1 of the conditions, made symmetric, as the steps of multipliers. */
static void centering_in_pairs(robot_online_workspace *work, double target)
{
    for (int32_t b = 0; b < ROBOT_ONLINE_SCALARS; ++b) {
        work->scalar_multiplier_steps[b] =
            (target - work->scalar_corrections[b]) / work->scalars[b];
    }
    for (int32_t b = 0; b < ROBOT_ONLINE_MATRICES; ++b) {
        const int32_t size = matrix_size[b];
        const int32_t at = matrix_place[b];
        const double *correction = &work->corrections[at];
        const double *s = &work->inverses[at];
        for (int32_t i = 0; i < size; ++i) {
            for (int32_t j = 0; j <= i; ++j) {
                robot_online_pair sum = pair_product(2.0 * target, s[(i * size) + j]);
                for (int32_t k = 0; k < size; ++k) {
                    add_pair(&sum, pair_product(-correction[(i * size) + k], s[(k * size) + j]));
                    add_pair(&sum, pair_product(-correction[(j * size) + k], s[(k * size) + i]));
                }
                work->multiplier_steps[at + (i * size) + j] = 0.5 * rounded_pair(sum);
                work->multiplier_steps[at + (j * size) + i] = 0.5 * rounded_pair(sum);
            }
        }
    }
}

/* The sum of the products of conditions and multipliers, after steps of the given lengths. */
static double gap_after_in_pairs(const robot_online_workspace *work, double length,
                                 double dual_length)
{
    robot_online_pair sum = pair_of(0.0);
    for (int32_t b = 0; b < ROBOT_ONLINE_SCALARS; ++b) {
        add_pair(&sum, pair_product(work->scalars[b] + (length * work->scalar_steps[b]),
                                    work->scalar_multipliers[b] +
                                        (dual_length * work->scalar_multiplier_steps[b])));
    }
    for (int32_t i = 0; i < ROBOT_ONLINE_ELEMENTS; ++i) {
        add_pair(&sum, pair_product(work->matrices[i] + (length * work->steps[i]),
                                    work->multipliers[i] +
                                        (dual_length * work->multiplier_steps[i])));
    }
    return rounded_pair(sum);
}

/* In pairs: add the curvature of the conditions: for unknowns v and w of a condition,
 * tr(A_w Z A_v S^-1), from the same for single elements of the condition. */
static void add_curvature_in_pairs(const structure *known, robot_online_workspace *work)
{
    const robot_online_index *place = known->condition_entry;
    int32_t next = 0;
    for (int32_t b = 0; b < ROBOT_ONLINE_SCALARS; ++b) {
        const double ratio = work->scalar_multipliers[b] / work->scalars[b];
        for (int32_t v = scalar_start[b]; v < scalar_start[b + 1]; ++v) {
            const robot_online_pair scaled = pair_product(ratio, scalar_value[v]);
            for (int32_t w = scalar_start[b]; w <= v; ++w) {
                add_pair(&work->matrix_pairs[place[next]],
                         pair_times(scaled, pair_of(scalar_value[w])));
                ++next;
            }
        }
    }
    for (int32_t b = 0; b < ROBOT_ONLINE_MATRICES; ++b) {
        const int32_t size = matrix_size[b];
        const double *z = &work->multipliers[matrix_place[b]];
        const double *s = &work->inverses[matrix_place[b]];
        robot_online_pair *products = work->product_pairs;
        int32_t first = 0;
        for (int32_t r = 0; r < size; ++r) {
            for (int32_t c = r; c < size; ++c) {
                int32_t second = 0;
                for (int32_t i = 0; i <= r; ++i) {
                    for (int32_t j = i; (j < size) && (second <= first); ++j) {
                        robot_online_pair sum = pair_product(z[(i * size) + r], s[(c * size) + j]);
                        if (i != j) {
                            add_pair(&sum, pair_product(z[(j * size) + r], s[(c * size) + i]));
                        }
                        if (r != c) {
                            add_pair(&sum, pair_product(z[(i * size) + c], s[(r * size) + j]));
                            if (i != j) {
                                add_pair(&sum, pair_product(z[(j * size) + c], s[(r * size) + i]));
                            }
                        }
                        products[(first * ROBOT_ONLINE_TRIANGLE) + second] = sum;
                        products[(second * ROBOT_ONLINE_TRIANGLE) + first] = sum;
                        ++second;
                    }
                }
                ++first;
            }
        }
        for (int32_t v = matrix_start[b]; v < matrix_start[b + 1]; ++v) {
            for (int32_t w = matrix_start[b]; w <= v; ++w) {
                robot_online_pair sum = pair_of(0.0);
                for (int32_t e = element_start[v]; e < element_start[v + 1]; ++e) {
                    const robot_online_pair *row =
                        &products[element_number[e] * ROBOT_ONLINE_TRIANGLE];
                    robot_online_pair part = pair_of(0.0);
                    for (int32_t f = element_start[w]; f < element_start[w + 1]; ++f) {
                        add_pair(&part,
                                 pair_times(row[element_number[f]], pair_of(element_value[f])));
                    }
                    add_pair(&sum, pair_times(part, pair_of(element_value[e])));
                }
                add_pair(&work->matrix_pairs[place[next]], sum);
                ++next;
            }
        }
    }
}

/* The Cholesky factor of the Newton matrix, with the inverses of its elements on the diagonal. */
static void factorize_in_pairs(const structure *known, robot_online_workspace *work)
{
    robot_online_pair *factor = work->factor_pairs;
    robot_online_pair *column = work->column_pairs;
    for (int32_t j = 0; j < ROBOT_ONLINE_VARIABLES; ++j) {
        const int32_t start = known->column_start[j];
        const int32_t end = known->column_start[j + 1];
        for (int32_t p = start; p < end; ++p) {
            column[known->row[p]] = work->matrix_pairs[p];
        }
        for (int32_t k = known->left_start[j]; k < known->left_start[j + 1]; ++k) {
            const int32_t first = known->left_entry[k];
            const int32_t last = known->column_start[known->left_column[k] + 1];
            const robot_online_pair value = negative_pair(factor[first]);
            for (int32_t p = first; p < last; ++p) {
                add_pair(&column[known->row[p]], pair_times(value, factor[p]));
            }
        }
        const robot_online_pair inverse = inverse_root_of_pair(column[j], work->matrix_pairs[start]);
        factor[start] = inverse;
        for (int32_t p = start + 1; p < end; ++p) {
            factor[p] = pair_times(column[known->row[p]], inverse);
        }
    }
}

/* The matrix of the Newton system and its factor. */
static void prepare_in_pairs(const structure *known, robot_online_workspace *work)
{
    for (int32_t i = 0; i < known->entries; ++i) {
        work->matrix_pairs[i] = pair_of(work->curvature[i]);
    }
    add_curvature_in_pairs(known, work);
    factorize_in_pairs(known, work);
}

/* Solve the Newton system in place. */
static void solve_in_pairs(const structure *known, robot_online_workspace *work, double *vector)
{
    const robot_online_pair *factor = work->factor_pairs;
    robot_online_pair *permuted = work->column_pairs;
    for (int32_t j = 0; j < ROBOT_ONLINE_VARIABLES; ++j) {
        permuted[j] = pair_of(vector[known->order[j]]);
    }
    for (int32_t j = 0; j < ROBOT_ONLINE_VARIABLES; ++j) {
        const int32_t start = known->column_start[j];
        permuted[j] = pair_times(permuted[j], factor[start]);
        const robot_online_pair value = negative_pair(permuted[j]);
        for (int32_t p = start + 1; p < known->column_start[j + 1]; ++p) {
            add_pair(&permuted[known->row[p]], pair_times(factor[p], value));
        }
    }
    for (int32_t j = ROBOT_ONLINE_VARIABLES - 1; j >= 0; --j) {
        const int32_t start = known->column_start[j];
        robot_online_pair value = permuted[j];
        for (int32_t p = start + 1; p < known->column_start[j + 1]; ++p) {
            add_pair(&value, pair_times(factor[p], negative_pair(permuted[known->row[p]])));
        }
        permuted[j] = pair_times(value, factor[start]);
    }
    for (int32_t j = 0; j < ROBOT_ONLINE_VARIABLES; ++j) {
        vector[known->order[j]] = rounded_pair(permuted[j]);
    }
}

/*TWICE*/
static void prepare_newton(const structure *known, robot_online_workspace *work)
{
    if (work->in_pairs) {
        prepare_in_pairs(known, work);
    } else {
        prepare_in_doubles(known, work);
    }
}

static void newton(const structure *known, robot_online_workspace *work, double *vector)
{
    if (work->in_pairs) {
        solve_in_pairs(known, work, vector);
    } else {
        solve_in_doubles(known, work, vector);
    }
}

static void balance(const structure *known, robot_online_workspace *work, const double *unknowns,
                    bool multipliers, bool steps, double *rest)
{
    if (work->in_pairs) {
        balance_in_pairs(known, work, unknowns, multipliers, steps, rest);
    } else {
        balance_in_doubles(known, work, unknowns, multipliers, steps, rest);
    }
}

static void conditions(const robot_online_workspace *work, const double *unknowns, double constant,
                       double margin, double *scalars, double *matrices)
{
    if (work->in_pairs) {
        conditions_in_pairs(unknowns, constant, margin, scalars, matrices);
    } else {
        conditions_in_doubles(unknowns, constant, margin, scalars, matrices);
    }
}

static void add_response(robot_online_workspace *work, const double *scalar_steps,
                         const double *steps)
{
    if (work->in_pairs) {
        add_response_in_pairs(work, scalar_steps, steps);
    } else {
        add_response_in_doubles(work, scalar_steps, steps);
    }
}

static void centering(robot_online_workspace *work, double target)
{
    if (work->in_pairs) {
        centering_in_pairs(work, target);
    } else {
        centering_in_doubles(work, target);
    }
}

static double gap_after(const robot_online_workspace *work, double length, double dual_length)
{
    return work->in_pairs ? gap_after_in_pairs(work, length, dual_length)
                          : gap_after_in_doubles(work, length, dual_length);
}

/* The inverse Cholesky factors of scalars and matrices; false where one is not positive definite. */
static bool invert_factors(const robot_online_workspace *work, const double *scalars,
                           const double *matrices, double *roots)
{
    bool inside = true;
    for (int32_t b = 0; b < ROBOT_ONLINE_SCALARS; ++b) {
        inside = inside && (scalars[b] > 0.0);
    }
    if (inside) {
        inside = work->in_pairs ? invert_matrices_in_pairs(matrices, roots)
                                : invert_matrices_in_doubles(matrices, roots);
    }
    return inside;
}

/* These and the inverses of the conditions; false where one is not positive definite. */
static bool invert_conditions(robot_online_workspace *work)
{
    const bool inside = invert_factors(work, work->scalars, work->matrices, work->roots);
    if (inside) {
        if (work->in_pairs) {
            invert_roots_in_pairs(work->roots, work->inverses);
        } else {
            invert_roots_in_doubles(work->roots, work->inverses);
        }
    }
    return inside;
}

/* ---------------------------------------------------------------------------------------------
 * The interior-point method: primal-dual, with the direction of Helmberg, Rendl, Vanderbei and
 * Wolkowicz, Kojima, Shindoh and Hara, and Monteiro, and Mehrotra's predictor. Every iterate is
 * strictly feasible, so that it can stop at any time.
 * ------------------------------------------------------------------------------------------- */

/* How many times a step may be taken before a condition or multiplier reaches the boundary. */
static double longest_step(const double *scalars, const double *scalar_steps, const double *roots,
                           const double *steps)
{
    double inverse = 0.0;
    for (int32_t b = 0; b < ROBOT_ONLINE_SCALARS; ++b) {
        if ((-scalar_steps[b]) > (inverse * scalars[b])) {
            inverse = -scalar_steps[b] / scalars[b];
        }
    }
    for (int32_t b = 0; b < ROBOT_ONLINE_MATRICES; ++b) {
        const int32_t size = matrix_size[b];
        const double *root = &roots[matrix_place[b]];
        const double *step = &steps[matrix_place[b]];
        double product[ROBOT_ONLINE_LARGEST * ROBOT_ONLINE_LARGEST];
        double both[ROBOT_ONLINE_LARGEST * ROBOT_ONLINE_LARGEST];
        for (int32_t i = 0; i < size; ++i) {
            for (int32_t j = 0; j < size; ++j) {
                double sum = 0.0;
                for (int32_t k = 0; k <= i; ++k) {
                    sum += root[(i * size) + k] * step[(k * size) + j];
                }
                product[(i * size) + j] = sum;
            }
        }
        for (int32_t i = 0; i < size; ++i) {
            for (int32_t j = 0; j <= i; ++j) {
                double sum = 0.0;
                for (int32_t k = 0; k <= j; ++k) {
                    sum += product[(i * size) + k] * root[(j * size) + k];
                }
                both[(i * size) + j] = sum;
                both[(j * size) + i] = sum;
            }
        }
        inverse = fmax(inverse, -smallest_eigenvalue(size, both));
    }
    return (inverse > 1e-12) ? (1.0 / inverse) : 1e12;
}

/* Let the corrections be zero. */
static void clear_corrections(robot_online_workspace *work)
{
    for (int32_t b = 0; b < ROBOT_ONLINE_SCALARS; ++b) {
        work->scalar_corrections[b] = 0.0;
    }
    for (int32_t i = 0; i < ROBOT_ONLINE_ELEMENTS; ++i) {
        work->corrections[i] = 0.0;
    }
}

/* Let the steps of the multipliers be zero. */
static void clear_steps(robot_online_workspace *work)
{
    for (int32_t b = 0; b < ROBOT_ONLINE_SCALARS; ++b) {
        work->scalar_multiplier_steps[b] = 0.0;
    }
    for (int32_t i = 0; i < ROBOT_ONLINE_ELEMENTS; ++i) {
        work->multiplier_steps[i] = 0.0;
    }
}

/* Subtract the multipliers from their steps. */
static void subtract_multipliers(robot_online_workspace *work)
{
    for (int32_t b = 0; b < ROBOT_ONLINE_SCALARS; ++b) {
        work->scalar_multiplier_steps[b] -= work->scalar_multipliers[b];
    }
    for (int32_t i = 0; i < ROBOT_ONLINE_ELEMENTS; ++i) {
        work->multiplier_steps[i] -= work->multipliers[i];
    }
}

/* The product of two square matrices. */
static void multiply(int32_t size, const double *left, const double *right, double *product)
{
    for (int32_t i = 0; i < size; ++i) {
        for (int32_t j = 0; j < size; ++j) {
            double sum = 0.0;
            for (int32_t k = 0; k < size; ++k) {
                sum += left[(i * size) + k] * right[(k * size) + j];
            }
            product[(i * size) + j] = sum;
        }
    }
}

/* dZ dS of the predictor, which its linear model leaves out. */
static void second_order(robot_online_workspace *work)
{
    for (int32_t b = 0; b < ROBOT_ONLINE_SCALARS; ++b) {
        work->scalar_corrections[b] = work->scalar_multiplier_steps[b] * work->scalar_steps[b];
    }
    for (int32_t b = 0; b < ROBOT_ONLINE_MATRICES; ++b) {
        const int32_t at = matrix_place[b];
        multiply(matrix_size[b], &work->multiplier_steps[at], &work->steps[at],
                 &work->corrections[at]);
    }
}

/* Take the unknowns as the start, with multipliers on the central path; false where these are not
 * strictly feasible. */
static bool begin_search(const structure *known, robot_online_workspace *work)
{
    conditions(work, work->unknowns, work->constant, work->margin, work->scalars, work->matrices);
    const bool inside = invert_conditions(work);
    if (inside) {
        /* The complementarity for which the multipliers balance the gradient best. */
        clear_corrections(work);
        work->length = 1.0;
        centering(work, 1.0);
        balance(known, work, work->unknowns, false, false, work->before);
        balance(known, work, work->unknowns, false, true, work->direction);
        double product = 0.0;
        double square = 0.0;
        for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
            const double slope = work->direction[i] - work->before[i];
            product -= work->before[i] * slope;
            square += slope * slope;
        }
        const double balance = product / fmax(square, 1e-300);
        const double target = fmax(balance, ROBOT_ONLINE_LEAST_START);
        for (int32_t i = 0; i < ROBOT_ONLINE_SCALARS; ++i) {
            work->scalar_multipliers[i] = target * work->scalar_multiplier_steps[i];
        }
        for (int32_t i = 0; i < ROBOT_ONLINE_ELEMENTS; ++i) {
            work->multipliers[i] = target * work->multiplier_steps[i];
        }
        for (int32_t i = 0; i < ROBOT_ONLINE_SCALARS; ++i) {
            work->scalar_multiplier_steps[i] = 0.0;
            work->scalar_steps[i] = 0.0;
        }
        for (int32_t i = 0; i < ROBOT_ONLINE_ELEMENTS; ++i) {
            work->multiplier_steps[i] = 0.0;
            work->steps[i] = 0.0;
        }
        work->gap = gap_after(work, 0.0, 0.0);
    }
    return inside;
}

/* Remove what rounding left of the dual equation in a direction: gradient after the step less the
 * product of the coefficients with the multipliers after the step. The small correction has a
 * small response, whose rounding errors are small too: the whole one is not computed anew. */
static void refine(const structure *known, robot_online_workspace *work)
{
    for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
        work->before[i] = work->unknowns[i] + work->direction[i];
    }
    balance(known, work, work->before, true, true, work->residual);
    newton(known, work, work->residual);
    conditions(work, work->residual, 0.0, 0.0, work->scalar_corrections, work->corrections);
    add_response(work, work->scalar_corrections, work->corrections);
    for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
        work->direction[i] += work->residual[i];
    }
}

/* One step of the method; false where it moves no further. */
static bool search_step(const structure *known, robot_online_workspace *work)
{
    bool moves = invert_factors(work, work->scalar_multipliers, work->multipliers,
                                work->multiplier_roots);
    if (moves) {
        prepare_newton(known, work);

        /* Predictor: as if the multipliers could vanish at once. */
        balance(known, work, work->unknowns, false, false, work->direction);
        newton(known, work, work->direction);
        conditions(work, work->direction, 0.0, 0.0, work->scalar_steps, work->steps);
        clear_steps(work);
        subtract_multipliers(work);
        add_response(work, work->scalar_steps, work->steps);
        double length = fmin(1.0, longest_step(work->scalars, work->scalar_steps, work->roots,
                                               work->steps));
        double dual_length = fmin(1.0, longest_step(work->scalar_multipliers,
                                                    work->scalar_multiplier_steps,
                                                    work->multiplier_roots, work->multiplier_steps));
        const double share = fmax(gap_after(work, length, dual_length), 0.0) / work->gap;
        const double reach = fmin(length, dual_length);
        const double power = fmax(1.0, 3.0 * reach * reach);
        const bool recenter = work->length < ROBOT_ONLINE_STALL;
        const double target =
            (recenter ? 1.0 : fmin(0.8, pow(share, power))) * work->gap / ROBOT_ONLINE_ORDER;

        /* Corrector; where the last step came to nothing, back to the central path first. */
        second_order(work);
        if (recenter) {
            clear_corrections(work);
        }
        centering(work, target);
        balance(known, work, work->unknowns, false, true, work->direction);
        newton(known, work, work->direction);
        conditions(work, work->direction, 0.0, 0.0, work->scalar_steps, work->steps);
        subtract_multipliers(work);
        add_response(work, work->scalar_steps, work->steps);
        for (int32_t refinement = 0; refinement < ROBOT_ONLINE_REFINEMENTS; ++refinement) {
            refine(known, work);
        }
        conditions(work, work->direction, 0.0, 0.0, work->scalar_steps, work->steps);
        length = longest_step(work->scalars, work->scalar_steps, work->roots, work->steps);
        dual_length = longest_step(work->scalar_multipliers, work->scalar_multiplier_steps,
                                   work->multiplier_roots, work->multiplier_steps);
        const double part = 0.9 + (0.09 * reach);
        length = fmin(1.0, part * fmin(length, dual_length));
        for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
            work->before[i] = work->unknowns[i];
        }
        bool inside = false;
        for (int32_t halving = 0; (halving < ROBOT_ONLINE_HALVINGS) && !inside; ++halving) {
            for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
                work->unknowns[i] = work->before[i] + (length * work->direction[i]);
            }
            conditions(work, work->unknowns, work->constant, work->margin, work->scalars, work->matrices);
            inside = invert_conditions(work);
            length = inside ? length : (0.5 * length);
        }
        if (!inside) {
            for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
                work->unknowns[i] = work->before[i];
            }
            conditions(work, work->unknowns, work->constant, work->margin, work->scalars, work->matrices);
            (void)invert_conditions(work);
            length = 0.0;
        }
        for (int32_t i = 0; i < ROBOT_ONLINE_SCALARS; ++i) {
            work->scalar_multipliers[i] += length * work->scalar_multiplier_steps[i];
        }
        for (int32_t i = 0; i < ROBOT_ONLINE_ELEMENTS; ++i) {
            work->multipliers[i] += length * work->multiplier_steps[i];
        }
        work->gap = gap_after(work, 0.0, 0.0);
        work->length = length;
        moves = length > ROBOT_ONLINE_LEAST_STEP;
    }
    return moves;
}

/* Whether every condition is proved at these unknowns, in SI, at a distance from the boundary: by
 * Cholesky factorizations of matrices from which a bound of the rounding errors was subtracted
 * (S. M. Rump, Verification of positive definiteness, BIT 46, 2006), twice, as matrices that are
 * evaluated in another order differ by rounding, too. */
static bool proved(robot_online_workspace *work, const double *unknowns, double distance)
{
    conditions_in_doubles(unknowns, 1.0, distance, work->scalar_steps, work->steps);
    bool inside = true;
    for (int32_t b = 0; b < ROBOT_ONLINE_SCALARS; ++b) {
        inside = inside && (work->scalar_steps[b] >= 0.0);
    }
    for (int32_t b = 0; (b < ROBOT_ONLINE_MATRICES) && inside; ++b) {
        const int32_t size = matrix_size[b];
        double *matrix = &work->steps[matrix_place[b]];
        double factor[ROBOT_ONLINE_LARGEST * ROBOT_ONLINE_LARGEST];
        double trace = 0.0;
        for (int32_t i = 0; i < size; ++i) {
            trace += fabs(matrix[(i * size) + i]);
        }
        const double shift = (4.0 * (size + 2) * DBL_EPSILON * trace) + DBL_MIN;
        for (int32_t i = 0; i < size; ++i) {
            matrix[(i * size) + i] -= shift;
        }
        inside = cholesky_in_doubles(size, matrix, factor);
    }
    return inside;
}

/* The base parameters of unknowns. */
static void base_of(const double *unknowns, double constant, double *base)
{
    for (int32_t r = 0; r < ROBOT_ONLINE_BASE_COUNT; ++r) {
        double sum = constant * base_constant[r];
        for (int32_t e = base_start[r]; e < base_start[r + 1]; ++e) {
            sum += base_value[e] * unknowns[base_variable[e]];
        }
        base[r] = sum;
    }
}

/* Where searches start, well inside: unknowns in units of `unit`. */
static void start_unknowns(double unit, double *unknowns)
{
    for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
        unknowns[i] = ROBOT_ONLINE_IS_CONE ? interior_point[i] : (interior_point[i] / unit);
    }
}

/* The length of what is missing of the dual equation: gradient less multipliers. */
static double dual_residual(const structure *known, robot_online_workspace *work)
{
    balance(known, work, work->unknowns, true, false, work->residual);
    double sum = 0.0;
    for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
        sum += work->residual[i] * work->residual[i];
    }
    return sqrt(sum);
}

/* Whether the search may end: it reached its accuracy, or came close and rounding hinders it. */
static bool has_ended(const robot_online_workspace *work, double residual, double size,
                      double before)
{
    const double goal = ROBOT_ONLINE_ACCURACY * size;
    const bool reached = (work->gap <= goal) && (residual <= ROBOT_ONLINE_DUAL_ACCURACY);
    const bool near = (work->gap <= (100.0 * goal)) &&
                      (residual <= (10.0 * ROBOT_ONLINE_DUAL_ACCURACY)) &&
                      ((work->gap >= before) || (work->length < 0.1));
    return reached || near;
}

/* Write the answer in SI, on the line to the start as far as a proof needs it. */
static void finish(robot_online_workspace *work, double unit, robot_online_status status,
                   robot_online_answer *answer)
{
    double *unknowns = work->direction;
    for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
        unknowns[i] = unit * work->unknowns[i];
    }
    bool inside = proved(work, unknowns, 0.0);
    double part = 1e-15;
    start_unknowns(unit, work->before);
    for (int32_t attempt = 0; (attempt < ROBOT_ONLINE_PULLS) && !inside; ++attempt) {
        for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
            unknowns[i] = unit * (((1.0 - part) * work->unknowns[i]) + (part * work->before[i]));
        }
        inside = proved(work, unknowns, 0.0);
        part *= 2.0;
    }
    if (!inside) {
        for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
            unknowns[i] = interior_point[i];
        }
    }
    for (int32_t r = 0; r < ROBOT_ONLINE_PARAMETER_COUNT; ++r) {
        double sum = parameter_constant[r];
        for (int32_t e = parameter_start[r]; e < parameter_start[r + 1]; ++e) {
            sum += parameter_value[e] * unknowns[parameter_variable[e]];
        }
        answer->parameters[r] = sum;
    }
    base_of(unknowns, 1.0, answer->base);
    answer->status = inside ? status : ROBOT_ONLINE_STOPPED;
}

/* The answer of a call that could not begin: the point at which searches start. */
static void refuse(robot_online_workspace *work, robot_online_answer *answer)
{
    start_unknowns(1.0, work->unknowns);
    finish(work, 1.0, ROBOT_ONLINE_REFUSED, answer);
    answer->iterations = 0;
    answer->objective = 0.0;
    answer->gap = 0.0;
}

/* ---------------------------------------------------------------------------------------------
 * The feasible correction.
 * ------------------------------------------------------------------------------------------- */

/* Let the squares of the parameters that do not show count as much as `change` more. */
static void weigh_unmeasured(robot_online_workspace *work, double change)
{
    for (int32_t i = 0; i < ROBOT_ONLINE_UNMEASURED; ++i) {
        work->curvature[unmeasured_entry[i]] +=
            change * ROBOT_ONLINE_UNMEASURED_WEIGHT * unmeasured_curvature[i];
    }
    for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
        work->linear[i] +=
            change * ROBOT_ONLINE_UNMEASURED_WEIGHT * work->constant * unmeasured_linear[i];
    }
}

/* Whether the given base parameters are possible with the other parameters as they are now; the
 * unknowns are then moved to them. */
static bool is_already_feasible(robot_online_workspace *work, const double *base, double unit)
{
    double *unknowns = work->before;
    bool inside = false;
    if (ROBOT_ONLINE_HAS_EQUATIONS == 0) {
        for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
            unknowns[i] = unit * work->unknowns[i];
        }
        base_of(unknowns, 1.0, work->found_base);
        for (int32_t r = 0; r < ROBOT_ONLINE_BASE_COUNT; ++r) {
            unknowns[independent[r]] += base[r] - work->found_base[r];
        }
        inside = proved(work, unknowns, 0.5 * ROBOT_ONLINE_MARGIN);
        for (int32_t i = 0; (i < ROBOT_ONLINE_VARIABLES) && inside; ++i) {
            work->unknowns[i] = unknowns[i] / unit;
        }
    }
    return inside;
}

robot_online_status robot_online_correct(const double *base, robot_online_workspace *work,
                                         robot_online_answer *answer)
{
    const structure *known = &correct_structure;
    double unit = 0.0;
    bool finite = true;
    for (int32_t i = 0; i < ROBOT_ONLINE_BASE_COUNT; ++i) {
        finite = finite && (fabs(base[i]) <= ROBOT_ONLINE_GREATEST);
        unit = fmax(unit, fabs(base[i]));
    }
    if (!finite) {
        refuse(work, answer);
        return answer->status;
    }
    /* What is smaller than the margin shows is resolved to that unit and no further. */
    const double least = ((unit > 0.0) && (unit < ROBOT_ONLINE_LEAST_UNIT)) ? 1.0 : ROBOT_ONLINE_FINE;
    unit = (unit > 0.0) ? fmax(unit, ROBOT_ONLINE_LEAST_UNIT) : fmax(1.0, ROBOT_ONLINE_LEAST_UNIT);

    work->constant = 1.0 / unit;
    work->margin = ROBOT_ONLINE_MARGIN / unit;
    work->in_pairs = false;
    for (int32_t i = 0; i < known->entries; ++i) {
        work->curvature[i] = 0.0;
    }
    for (int32_t i = 0; i < ROBOT_ONLINE_DISTANCE_ENTRIES; ++i) {
        work->curvature[distance_entry[i]] = distance_value[i];
    }
    for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
        work->linear[i] = 0.0;
    }
    for (int32_t r = 0; r < ROBOT_ONLINE_BASE_COUNT; ++r) {
        const double difference = (base[r] - base_constant[r]) / unit;
        for (int32_t e = base_start[r]; e < base_start[r + 1]; ++e) {
            work->linear[base_variable[e]] -= 2.0 * base_value[e] * difference;
        }
    }
    double weight = 1.0;
    weigh_unmeasured(work, weight);
    start_unknowns(unit, work->unknowns);

    robot_online_status status = ROBOT_ONLINE_STOPPED;
    bool moves = begin_search(known, work);
    bool weighed = false;
    double before = work->gap;
    double squared = 0.0;
    int32_t iterations = 0;
    int32_t in_pairs = 0;
    while (moves && (status == ROBOT_ONLINE_STOPPED)) {
        base_of(work->unknowns, work->constant, work->found_base);
        squared = 0.0;
        for (int32_t r = 0; r < ROBOT_ONLINE_BASE_COUNT; ++r) {
            const double difference = work->found_base[r] - (base[r] / unit);
            squared += difference * difference;
        }
        const double size = fmax(squared, least);
        const double residual = dual_residual(known, work);
        if ((squared < ROBOT_ONLINE_FINE) && is_already_feasible(work, base, unit)) {
            status = ROBOT_ONLINE_UNCHANGED;
        } else if (!weighed && (work->gap < (1e-3 * size)) && (residual < 1e-4)) {
            /* Where little has to change, the parameters that do not show count less, so that
             * they do not decide what does. */
            weighed = true;
            if (squared < ROBOT_ONLINE_FINE) {
                const double less = fmin(1.0, fmax(squared * unit * unit, 1e-6));
                weigh_unmeasured(work, less - weight);
                weight = less;
            }
        } else if (has_ended(work, residual, size, before)) {
            status = ROBOT_ONLINE_SOLVED;
        } else {
            /* Not there yet. */
        }
        before = work->gap;
        /* Short steps before it are those that rounding hinders, unless the search has just begun. */
        const bool hindered = (work->gap < (10.0 * ROBOT_ONLINE_PAIRS_BELOW * size)) &&
                              (residual < ROBOT_ONLINE_PAIRS_BELOW) && (work->length < 0.5);
        work->in_pairs =
            work->in_pairs || hindered || (work->gap < (ROBOT_ONLINE_PAIRS_BELOW * size));
        if (status == ROBOT_ONLINE_STOPPED) {
            moves = (iterations < ROBOT_ONLINE_ITERATIONS) && (in_pairs < ROBOT_ONLINE_PAIR_STEPS) &&
                    search_step(known, work);
            iterations += moves ? 1 : 0;
            in_pairs += (moves && work->in_pairs) ? 1 : 0;
            if (!moves && !work->in_pairs) {
                /* Rounding hinders it before its time. */
                work->in_pairs = true;
                moves = true;
            }
        }
    }
    if ((status == ROBOT_ONLINE_STOPPED) &&
        (work->gap <= (ROBOT_ONLINE_FAIR * fmax(squared, ROBOT_ONLINE_FINE)))) {
        status = ROBOT_ONLINE_SOLVED;
    }
    answer->gap = work->gap * unit * unit;
    finish(work, unit, status, answer);
    if (answer->status == ROBOT_ONLINE_UNCHANGED) {
        for (int32_t r = 0; r < ROBOT_ONLINE_BASE_COUNT; ++r) {
            answer->base[r] = base[r];
        }
    }
    answer->objective = 0.0;
    for (int32_t r = 0; r < ROBOT_ONLINE_BASE_COUNT; ++r) {
        const double difference = answer->base[r] - base[r];
        answer->objective += difference * difference;
    }
    answer->iterations = iterations;
    return answer->status;
}

/* ---------------------------------------------------------------------------------------------
 * Data: for each joint the triangular factor of its rows [regressor, torque].
 * ------------------------------------------------------------------------------------------- */

void robot_online_begin(robot_online_data *data)
{
    for (int32_t i = 0; i < ROBOT_ONLINE_TRIANGLE_SIZE; ++i) {
        data->triangle[i] = 0.0;
    }
    for (int32_t j = 0; j < ROBOT_ONLINE_JOINT_COUNT; ++j) {
        data->count[j] = 0.0;
    }
}

robot_online_status robot_online_update(robot_online_data *data, const double *regressor,
                                        const double *torque, double forget,
                                        robot_online_workspace *work)
{
    bool all[ROBOT_ONLINE_JOINT_COUNT];
    for (int32_t j = 0; j < ROBOT_ONLINE_JOINT_COUNT; ++j) {
        all[j] = true;
    }
    return robot_online_update_joints(data, regressor, torque, all, forget, work);
}

robot_online_status robot_online_update_joints(robot_online_data *data, const double *regressor,
                                               const double *torque, const bool *counted,
                                               double forget, robot_online_workspace *work)
{
    bool usable = (forget > 0.0) && (forget <= 1.0);
    for (int32_t j = 0; j < ROBOT_ONLINE_JOINT_COUNT; ++j) {
        if (counted[j]) {
            usable = usable && (fabs(torque[j]) <= ROBOT_ONLINE_GREATEST);
            for (int32_t i = 0; i < ROBOT_ONLINE_BASE_COUNT; ++i) {
                usable = usable && (fabs(regressor[(j * ROBOT_ONLINE_BASE_COUNT) + i]) <=
                                    ROBOT_ONLINE_GREATEST);
            }
        }
    }
    if (!usable) {
        return ROBOT_ONLINE_REFUSED;
    }
    const double factor = sqrt(forget);
    for (int32_t j = 0; j < ROBOT_ONLINE_JOINT_COUNT; ++j) {
        if (!counted[j]) {
            continue;
        }
        const int32_t width = joint_start[j + 1] - joint_start[j];
        double *row = work->row;
        double *triangle = &data->triangle[triangle_start[j]];
        for (int32_t i = 0; i < width; ++i) {
            row[i] = regressor[(j * ROBOT_ONLINE_BASE_COUNT) + joint_column[joint_start[j] + i]];
        }
        row[width] = torque[j];
        /* Givens rotations turn the new row into the triangle, row after row of it. */
        for (int32_t i = 0; i <= width; ++i) {
            const int32_t length = (width + 1) - i;
            const double old = factor * triangle[0];
            const double added = row[i];
            if (added != 0.0) {
                const double radius = hypot(old, added);
                const double cosine = old / radius;
                const double sine = added / radius;
                triangle[0] = radius;
                for (int32_t k = 1; k < length; ++k) {
                    const double above = factor * triangle[k];
                    triangle[k] = (cosine * above) + (sine * row[i + k]);
                    row[i + k] = (cosine * row[i + k]) - (sine * above);
                }
            } else {
                for (int32_t k = 0; k < length; ++k) {
                    triangle[k] *= factor;
                }
            }
            triangle = &triangle[length];
        }
        data->count[j] = (forget * data->count[j]) + 1.0;
    }
    return ROBOT_ONLINE_SOLVED;
}

void robot_online_squared_residuals(const robot_online_data *data, const double *base,
                                    double *squares)
{
    for (int32_t j = 0; j < ROBOT_ONLINE_JOINT_COUNT; ++j) {
        const int32_t width = joint_start[j + 1] - joint_start[j];
        const double *triangle = &data->triangle[triangle_start[j]];
        squares[j] = 0.0;
        for (int32_t i = 0; i <= width; ++i) {
            const int32_t length = (width + 1) - i;
            double difference = -triangle[length - 1];
            for (int32_t k = 0; k < (length - 1); ++k) {
                difference += triangle[k] * base[joint_column[joint_start[j] + i + k]];
            }
            squares[j] += difference * difference;
            triangle = &triangle[length];
        }
    }
}

/* ---------------------------------------------------------------------------------------------
 * The feasible fit.
 * ------------------------------------------------------------------------------------------- */

/* The weighted normal matrix G and G b of the data, in base parameters; false where these or the
 * weights are no numbers. */
static bool normal_matrix(const robot_online_data *data, const double *weights,
                          robot_online_workspace *work, double *constant)
{
    bool usable = true;
    for (int32_t i = 0; i < (ROBOT_ONLINE_BASE_COUNT * ROBOT_ONLINE_BASE_COUNT); ++i) {
        work->normal[i] = 0.0;
    }
    for (int32_t i = 0; i < ROBOT_ONLINE_BASE_COUNT; ++i) {
        work->found_base[i] = 0.0;
    }
    *constant = 0.0;
    for (int32_t j = 0; j < ROBOT_ONLINE_JOINT_COUNT; ++j) {
        const int32_t width = joint_start[j + 1] - joint_start[j];
        const robot_online_index *column = &joint_column[joint_start[j]];
        const double *triangle = &data->triangle[triangle_start[j]];
        const double square = weights[j] * weights[j];
        usable = usable && (weights[j] >= 0.0) && (weights[j] <= ROBOT_ONLINE_GREATEST);
        for (int32_t i = 0; i <= width; ++i) {
            const int32_t length = (width + 1) - i;
            const double last = triangle[length - 1];
            for (int32_t k = 0; k < (length - 1); ++k) {
                const double value = square * triangle[k];
                usable = usable && (fabs(triangle[k]) <= ROBOT_ONLINE_GREATEST);
                work->found_base[column[i + k]] += value * last;
                for (int32_t l = 0; l <= k; ++l) {
                    work->normal[(column[i + k] * ROBOT_ONLINE_BASE_COUNT) + column[i + l]] +=
                        value * triangle[l];
                }
            }
            usable = usable && (fabs(last) <= ROBOT_ONLINE_GREATEST);
            *constant += square * last * last;
            triangle = &triangle[length];
        }
    }
    return usable;
}

robot_online_status robot_online_fit(const robot_online_data *data, const double *weights,
                                     double prior_weight, robot_online_workspace *work,
                                     robot_online_answer *answer)
{
    const structure *known = &fit_structure;
    double constant = 0.0;
    /* The objective is divided by what is at least that large, and stays a number. */
    bool usable = (prior_weight >= (1.0 / ROBOT_ONLINE_GREATEST)) && (prior_weight <= ROBOT_ONLINE_GREATEST);
    usable = normal_matrix(data, weights, work, &constant) && usable;
    if (!usable) {
        refuse(work, answer);
        return answer->status;
    }
    for (int32_t i = 0; i < known->entries; ++i) {
        work->curvature[i] = 0.0;
    }
    for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
        work->linear[i] = prior_weight * prior_linear[i];
    }
    for (int32_t i = 0; i < ROBOT_ONLINE_PRIOR_ENTRIES; ++i) {
        work->curvature[prior_entry[i]] += prior_weight * prior_curvature[i];
    }
    /* ½ |R (K y + k) - rho|² = ½ y'K'G K y + (G k - g)'K y + ... */
    for (int32_t r = 0; r < ROBOT_ONLINE_BASE_COUNT; ++r) {
        double slope = -work->found_base[r];
        for (int32_t c = 0; c < ROBOT_ONLINE_BASE_COUNT; ++c) {
            const double value = (c <= r) ? work->normal[(r * ROBOT_ONLINE_BASE_COUNT) + c]
                                          : work->normal[(c * ROBOT_ONLINE_BASE_COUNT) + r];
            slope += value * base_constant[c];
            constant += base_constant[r] * value * base_constant[c];
        }
        constant -= 2.0 * work->found_base[r] * base_constant[r];
        for (int32_t e = base_start[r]; e < base_start[r + 1]; ++e) {
            work->linear[base_variable[e]] += base_value[e] * slope;
        }
        for (int32_t c = 0; c <= r; ++c) {
            const double value = work->normal[(r * ROBOT_ONLINE_BASE_COUNT) + c];
            if (value != 0.0) {
                for (int32_t e = base_start[r]; e < base_start[r + 1]; ++e) {
                    for (int32_t f = base_start[c]; f < base_start[c + 1]; ++f) {
                        const int32_t i = fit_place[base_variable[e]];
                        const int32_t j = fit_place[base_variable[f]];
                        const int32_t high = (i > j) ? i : j;
                        const int32_t low = (i > j) ? j : i;
                        const double product = value * base_value[e] * base_value[f];
                        /* The mirrored element of G adds the mirrored product. */
                        work->curvature[known->column_start[low] + (high - low)] +=
                            ((r != c) && (high == low)) ? (2.0 * product)
                            : (((r == c) && (i < j)) ? 0.0 : product);
                    }
                }
            }
        }
    }
    constant = (0.5 * constant) + (prior_weight * ROBOT_ONLINE_PRIOR_CONSTANT);
    double size = 0.0;
    for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
        size = fmax(size, work->curvature[known->column_start[i]]);
    }
    for (int32_t i = 0; i < known->entries; ++i) {
        work->curvature[i] /= size;
    }
    for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
        work->linear[i] /= size;
    }
    constant /= size;

    work->constant = 1.0;
    work->margin = ROBOT_ONLINE_MARGIN;
    work->in_pairs = false;
    start_unknowns(1.0, work->unknowns);
    robot_online_status status = ROBOT_ONLINE_STOPPED;
    bool moves = begin_search(known, work);
    double before = work->gap;
    double value = 0.0;
    int32_t iterations = 0;
    while (moves && (status == ROBOT_ONLINE_STOPPED)) {
        balance(known, work, work->unknowns, false, false, work->direction);
        value = constant;
        for (int32_t i = 0; i < ROBOT_ONLINE_VARIABLES; ++i) {
            value += 0.5 * work->unknowns[i] * (work->linear[i] - work->direction[i]);
        }
        if (has_ended(work, dual_residual(known, work), fmax(value, 0.0), before)) {
            status = ROBOT_ONLINE_SOLVED;
        } else {
            before = work->gap;
            moves = (iterations < ROBOT_ONLINE_ITERATIONS) && search_step(known, work);
            iterations += moves ? 1 : 0;
        }
    }
    if ((status == ROBOT_ONLINE_STOPPED) &&
        (work->gap <= (ROBOT_ONLINE_FAIR * fmax(value, 0.0)))) {
        status = ROBOT_ONLINE_SOLVED;
    }
    finish(work, 1.0, status, answer);
    answer->gap = work->gap * size;
    answer->objective = value * size;
    answer->iterations = iterations;
    return answer->status;
}
