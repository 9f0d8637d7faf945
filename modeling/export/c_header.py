"""Mixture regressions as C99 headers: constants and loops, no allocation, no dependency but <math.h>."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..curvature import SLOWEST
from ..estimator import FloatArray
from ..lookahead_models import SPEED
from .plain_regression import PlainRegression

BLOCK = 16
"""Rows of a matrix that are computed together: their sums stay in registers, and compilers make vectors of them."""

NEGLIGIBLE = 37.0
"""nats; a component that much less likely than the best one has a responsibility below 1e-16: nothing of it is left
in the sums, and neither the rest of its density nor its regression is computed."""


def c_header(plain: PlainRegression, name: str, title: Sequence[str], inputs: Sequence[str], outputs: str) -> str:
    """Return a header with the functions of a regression, the formulas of `PlainRegression`.

        double wheelprint_<name>_predict(const double *inputs, double *mean, double *variance);
        double wheelprint_<name>_domain_score(const double *inputs);

    Both return the domain score, nats; `inputs` and `mean` are in the units of the model, `variance` in their squares.
    Everything is `static`: include the header in one source file of a program. Matrices lie in blocks of `BLOCK` rows,
    column after column, the triangular ones only up to their diagonal: a prediction reads them once, from the first to
    the last number.

    Args:
        plain: The regression.
        name: A C identifier.
        title: What the header is about, a line each.
        inputs: What each input is, with its unit.
        outputs: What the outputs are, with their unit.
    """
    arrays, coordinates = _arrays(plain), plain.coordinates
    classes = "" if plain.classes is None else CLASS_OF
    facts = [*title, "", *(f"inputs[{place}]  {line}" for place, line in enumerate(inputs)), "", outputs]
    text = TEMPLATE
    for key, value in {
        "COMMENT": "\n".join(f" * {line}".rstrip() for line in facts).replace("*/", "* /"),
        "ARRAYS": "\n".join(_array(f"wheelprint_{name}_{key}", values) for key, values in arrays.items()),
        "CLASS_OF": classes,
        "COORDINATES": "" if coordinates is None else COORDINATES,
        "MADE": "" if coordinates is None else MADE_INPUTS,
        "X": "inputs" if coordinates is None else "x",
        "ANGLE": ANGLE if coordinates is not None and coordinates.seen else "",
        "CALIBRATION": CALIBRATION if "variance_factors" in arrays else "",
        "CLASS_AT_HAND": "    const int own_class = wheelprint_@NAME@_class(x);\n" if classes else "",
        "OTHER_CLASS": OTHER_CLASS if classes else "",
        "BETA": FAITHFUL_BETA if plain.faithful else "",
        "VARIANCE": FAITHFUL_VARIANCE if plain.faithful else TOTAL_VARIANCE,
        "MIXED": "responsibility * responsibility" if plain.faithful else "responsibility",
        "SPEED": str(SPEED),
        "LENGTH": "" if coordinates is None else str(coordinates.path_length),
        "SEEN": "" if coordinates is None else str(coordinates.seen),
        "CHANNELS": "" if coordinates is None else str(len(coordinates.mean)),
        "STEP": "" if coordinates is None else repr(coordinates.step),
        "PER_KM": "" if coordinates is None else repr(1e3 * math.radians(1.0) / coordinates.step),
        "SLOWEST": repr(SLOWEST),
        "CLASSES": str(0 if plain.classes is None else len(plain.classes.polynomials)),
        "TRIANGLE": str(arrays["whitening"].shape[1]),
        "MATRIX": str(arrays["matrices"].shape[1]),
        # Without its weight a component may count for more.
        "NEGLIGIBLE": repr(NEGLIGIBLE + (float(np.ptp(plain.log_weights)) if plain.faithful else 0.0)),
        "BLOCK": str(BLOCK),
        "ROWS_IN": str(_whole_blocks(plain.inputs)),
        "ROWS_OUT": str(_whole_blocks(plain.outputs)),
        "GUARD": f"WHEELPRINT_{name}_H",
        "NAME": name,
        "GIVEN": str(plain.given),
        "N": str(plain.inputs),
        "M": str(plain.outputs),
        "K": str(plain.components),
    }.items():
        text = text.replace(f"@{key}@", value)
    return text


def c_identifier(name: str) -> str:
    """Return a name as the end of a C identifier: ASCII letters and digits, anything else as `_u` and its code.

    Two names never give the same identifier.
    """
    return "".join(letter if letter.isascii() and letter.isalnum() else f"_u{ord(letter):x}_" for letter in name)


def _arrays(plain: PlainRegression) -> dict[str, npt.NDArray[np.floating | np.integer]]:
    """Return the constants of a header by name."""
    arrays: dict[str, npt.NDArray[np.floating | np.integer]] = {
        "order": plain.order,
        "origin": plain.origin[plain.order],
        "constants": plain.constants,
        "shifts": _padded(plain.shifts, _whole_blocks(plain.inputs)),
        "whitening": np.array([_blocks(matrix, triangular=True) for matrix in plain.whitening]),
        "offsets": _padded(plain.offsets, _whole_blocks(plain.outputs)),
        "matrices": np.array([_blocks(matrix, triangular=False) for matrix in plain.matrices[:, :, plain.order]]),
        "variances": np.diagonal(plain.covariances, axis1=1, axis2=2),
    }
    if plain.faithful:
        arrays["log_weights"] = plain.log_weights
    if plain.classes is not None:
        arrays["class_polynomials"] = plain.classes.polynomials
        arrays["component_classes"] = plain.classes.of_component
    if plain.coordinates is not None:
        arrays["channel_means"] = plain.coordinates.mean
        arrays["basis"] = _blocks(plain.coordinates.basis.T, triangular=False)
    if (plain.variance_factors != 1.0).any():
        arrays["variance_factors"] = plain.variance_factors
    return arrays


def _whole_blocks(rows: int) -> int:
    return -(-rows // BLOCK) * BLOCK


def _blocks(matrix: FloatArray, *, triangular: bool) -> FloatArray:
    """Return a matrix (rows, columns) in blocks of rows, each column by column, up to the diagonal where triangular."""
    padded = np.zeros((_whole_blocks(len(matrix)), matrix.shape[1]))
    padded[: len(matrix)] = matrix
    parts = [
        padded[start : start + BLOCK, : min(start + BLOCK, matrix.shape[1]) if triangular else None].T.ravel()
        for start in range(0, len(padded), BLOCK)
    ]
    return np.concatenate(parts)


def _padded(rows: FloatArray, width: int) -> FloatArray:
    return np.pad(rows, ((0, 0), (0, width - rows.shape[1])))


def _array(name: str, values: npt.NDArray[np.floating | np.integer]) -> str:
    """Return the definition of a flat array; the shortest decimals that read back as the same doubles."""
    kind = "int" if values.dtype.kind == "i" else "double"
    numbers = ", ".join(map(repr, values.ravel().tolist()))
    body = textwrap.fill(numbers, 118, initial_indent="    ", subsequent_indent="    ", break_on_hyphens=False)
    return f"static const {kind} {name}[{values.size}] = {{\n{body}}};\n"


CLASS_OF = """
/* The class of speed at hand (PP eq. 19). */
static inline int wheelprint_@NAME@_class(const double *inputs)
{
    const double speed = inputs[@SPEED@];
    int best = 0;
    double most = 0.0;
    for (int c = 0; c < @CLASSES@; c++) {
        const double *polynomial = wheelprint_@NAME@_class_polynomials + 3 * c;
        const double value = polynomial[0] + (polynomial[1] + polynomial[2] * speed) * speed;
        if (c == 0 || value > most) {
            most = value;
            best = c;
        }
    }
    return best;
}
"""

OTHER_CLASS = """        if (wheelprint_@NAME@_component_classes[k] != own_class) {
            joint[k] = -HUGE_VAL;
            done[k] = @ROWS_IN@;
        }
"""

MADE_INPUTS = """    double x[@ROWS_IN@];
    wheelprint_@NAME@_coordinates(inputs, x);
"""

COORDINATES = """
/* Curvature (1/km), lateral acceleration, its product with braking, and angles, as coordinates. */
static inline void wheelprint_@NAME@_coordinates(const double *inputs, double *x)
{
    const double *speed = inputs + @LENGTH@, *matrix = wheelprint_@NAME@_basis;
    double channels[@CHANNELS@];
    for (int i = 0; i < @LENGTH@; i++) {
        const int before = i > 0 ? i - 1 : 0, after = i < @LENGTH@ - 1 ? i + 1 : i;
        const double acceleration = (speed[after] - speed[before]) / (@STEP@ * (after - before));
        channels[i] = inputs[i] * @PER_KM@ / (speed[i] > @SLOWEST@ ? speed[i] : @SLOWEST@);
        channels[@LENGTH@ + i] = 1e-3 * channels[i] * speed[i] * speed[i];
        channels[2 * @LENGTH@ + i] = channels[@LENGTH@ + i] * acceleration;
    }
    for (int i = 0; i < @SEEN@; i++) {
        channels[3 * @LENGTH@ + i] = inputs[2 * @LENGTH@ + i];
    }
    for (int i = 0; i < @CHANNELS@; i++) {
        channels[i] -= wheelprint_@NAME@_channel_means[i];
    }
    for (int row = 0; row < @ROWS_IN@; row += @BLOCK@) {
        for (int i = row; i < row + @BLOCK@; i++) {
            x[i] = 0.0;
        }
        matrix = wheelprint_@NAME@_block(matrix, channels, @CHANNELS@, x + row);
    }
}
"""

ANGLE = """    for (int i = 0; i < @M@; i++) { /* The change was predicted, from the last angle. */
        mean[i] += inputs[@GIVEN@ - 1];
    }
"""

CALIBRATION = """    for (int i = 0; i < @M@; i++) {
        variance[i] *= wheelprint_@NAME@_variance_factors[i];
    }
"""

FAITHFUL_BETA = """
    /* MP eq. 20 as printed: responsibilities without the weights. */
    double most = -HUGE_VAL, sum = 0.0;
    for (int k = 0; k < @K@; k++) {
        responsibilities[k] = joint[k] - wheelprint_@NAME@_log_weights[k];
        most = responsibilities[k] > most ? responsibilities[k] : most;
    }
    for (int k = 0; k < @K@; k++) {
        sum += exp(responsibilities[k] - most);
    }
    for (int k = 0; k < @K@; k++) {
        responsibilities[k] = exp(responsibilities[k] - most) / sum;
    }
"""

TOTAL_VARIANCE = """    for (int k = 0; k < @K@; k++) {
        if (responsibilities[k] > 0.0) {
            for (int i = 0; i < @M@; i++) {
                const double offset = means[k][i] - mean[i];
                variance[i] += responsibilities[k] * (wheelprint_@NAME@_variances[@M@ * k + i] + offset * offset);
            }
        }
    }
"""

FAITHFUL_VARIANCE = """    for (int k = 0; k < @K@; k++) { /* MP eq. 22 as printed */
        for (int i = 0; i < @M@; i++) {
            variance[i] += responsibilities[k] * responsibilities[k] * wheelprint_@NAME@_variances[@M@ * k + i];
        }
    }
"""

TEMPLATE = """/*
@COMMENT@
 *
 * C99, float64, no allocation. Include it in one source file and link with -lm.
 */
#ifndef @GUARD@
#define @GUARD@

#include <math.h>

/* GCC compiles the loops a second time for processors with AVX2, and the program chooses when it is loaded. */
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__GLIBC__) && !defined(__AVX2__)
#define WHEELPRINT_@NAME@_CLONED __attribute__((target_clones("avx2", "default"), unused)) static
#else
#define WHEELPRINT_@NAME@_CLONED static inline
#endif

#define WHEELPRINT_@NAME@_INPUTS @GIVEN@
#define WHEELPRINT_@NAME@_OUTPUTS @M@

@ARRAYS@@CLASS_OF@
/* sums[i] += matrix[i] . values for the next @BLOCK@ rows of a matrix, which are stored column by column. */
static inline const double *wheelprint_@NAME@_block(const double *restrict matrix, const double *restrict values,
                                                    int columns, double *restrict sums)
{
    int j = 0;
    for (; j + 3 < columns; j += 4, matrix += 4 * @BLOCK@) {
        const double a = values[j], b = values[j + 1], c = values[j + 2], d = values[j + 3];
        for (int i = 0; i < @BLOCK@; i++) {
            sums[i] += (matrix[i] * a + matrix[@BLOCK@ + i] * b)
                       + (matrix[2 * @BLOCK@ + i] * c + matrix[3 * @BLOCK@ + i] * d);
        }
    }
    for (; j < columns; j++, matrix += @BLOCK@) {
        for (int i = 0; i < @BLOCK@; i++) {
            sums[i] += matrix[i] * values[j];
        }
    }
    return matrix;
}
@COORDINATES@
/* Log of weight times density of the inputs by component; returns the log of their sum, the domain score. */
WHEELPRINT_@NAME@_CLONED double wheelprint_@NAME@_densities(const double *x, double *centred, double *joint)
{
    const double *matrix[@K@];
    double best = -HUGE_VAL, sum = 0.0;
    int done[@K@]; /* rows of the whitened inputs */
@CLASS_AT_HAND@    for (int j = 0; j < @N@; j++) {
        centred[j] = x[wheelprint_@NAME@_order[j]] - wheelprint_@NAME@_origin[j];
    }
    for (int k = 0; k < @K@; k++) {
        joint[k] = wheelprint_@NAME@_constants[k];
        matrix[k] = wheelprint_@NAME@_whitening + @TRIANGLE@ * k;
        done[k] = 0;
@OTHER_CLASS@    }
    for (;;) {
        /* joint[k] only falls while it is computed: the largest one goes on, until all that are left are negligible
           beside the best complete one. */
        double z[@BLOCK@];
        int next = -1;
        for (int k = 0; k < @K@; k++) {
            if (done[k] < @ROWS_IN@ && joint[k] > best - @NEGLIGIBLE@ && (next < 0 || joint[k] > joint[next])) {
                next = k;
            }
        }
        if (next < 0) {
            break;
        }
        for (int i = 0; i < @BLOCK@; i++) {
            z[i] = wheelprint_@NAME@_shifts[@ROWS_IN@ * next + done[next] + i];
        }
        done[next] += @BLOCK@;
        matrix[next] = wheelprint_@NAME@_block(matrix[next], centred, done[next] < @N@ ? done[next] : @N@, z);
        for (int i = 0; i < @BLOCK@; i++) {
            joint[next] -= 0.5 * z[i] * z[i];
        }
        if (done[next] == @ROWS_IN@ && joint[next] > best) {
            best = joint[next];
        }
    }
    for (int k = 0; k < @K@; k++) {
        sum += exp(joint[k] - best);
    }
    return best + log(sum);
}

/* Log density of the inputs where the model learnt, nats. */
WHEELPRINT_@NAME@_CLONED double wheelprint_@NAME@_domain_score(const double *inputs)
{
@MADE@    double centred[@N@], joint[@K@];
    return wheelprint_@NAME@_densities(@X@, centred, joint);
}

/* Mean and variance of each output; returns the domain score. */
WHEELPRINT_@NAME@_CLONED double wheelprint_@NAME@_predict(const double *inputs, double *mean, double *variance)
{
@MADE@    double centred[@N@], joint[@K@], responsibilities[@K@], means[@K@][@ROWS_OUT@];
    const double score = wheelprint_@NAME@_densities(@X@, centred, joint);
    for (int k = 0; k < @K@; k++) {
        const double log_responsibility = joint[k] - score;
        responsibilities[k] = log_responsibility > -@NEGLIGIBLE@ ? exp(log_responsibility) : 0.0;
    }
@BETA@    for (int i = 0; i < @M@; i++) {
        mean[i] = 0.0;
        variance[i] = 0.0;
    }
    for (int k = 0; k < @K@; k++) {
        if (responsibilities[k] > 0.0) {
            const double *matrix = wheelprint_@NAME@_matrices + @MATRIX@ * k;
            for (int row = 0; row < @ROWS_OUT@; row += @BLOCK@) {
                for (int i = row; i < row + @BLOCK@; i++) {
                    means[k][i] = wheelprint_@NAME@_offsets[@ROWS_OUT@ * k + i];
                }
                matrix = wheelprint_@NAME@_block(matrix, centred, @N@, means[k] + row);
            }
            for (int i = 0; i < @M@; i++) {
                mean[i] += responsibilities[k] * means[k][i];
            }
        }
    }
@VARIANCE@@CALIBRATION@@ANGLE@    return score;
}

#endif
"""
