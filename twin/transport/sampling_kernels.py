"""Random numbers and sampling routines of the Monte Carlo, as Warp functions.

Random numbers are counter-based: every path has its own SplitMix64 stream (Steele, Lea,
Flood 2014) whose start is a hash of (seed, stream, block, path), so a path's numbers do not
depend on which thread, chunk or machine traces it. Low-discrepancy points are shifted at
random per block and step, which keeps blocks independent of each other.
"""

from __future__ import annotations

import warp as wp

GOLDEN_GAMMA = wp.constant(wp.uint64(0x9E3779B97F4A7C15))
MIX_1 = wp.constant(wp.uint64(0xBF58476D1CE4E5B9))
MIX_2 = wp.constant(wp.uint64(0x94D049BB133111EB))
TWO_POW_MINUS_24 = wp.constant(5.9604644775390625e-08)
TWO_PI = wp.constant(6.283185307179586)

vec8 = wp.types.vector(length=8, dtype=wp.float32)

# the golden ratio's fraction, then odd numbers searched for evenness of every pair of
# coordinates; times 2**32, signed
STEP_0 = wp.constant(-1640531527)
STEP_1 = wp.constant(1812432103)
STEP_2 = wp.constant(1204883107)
STEP_3 = wp.constant(1779620671)
STEP_4 = wp.constant(1552595469)
STEP_5 = wp.constant(1798576933)
STEP_6 = wp.constant(1627687145)
STEP_7 = wp.constant(1182439219)


@wp.func
def mix64(value: wp.uint64) -> wp.uint64:
    """SplitMix64's output function: a bijective hash of 64 bits."""
    z = value
    z = (z ^ (z >> wp.uint64(30))) * MIX_1
    z = (z ^ (z >> wp.uint64(27))) * MIX_2
    return z ^ (z >> wp.uint64(31))


@wp.func
def stream_start(seed: wp.uint64, stream: int, block: int, path: int) -> wp.uint64:
    """Start of the stream of one path."""
    key = mix64(seed + GOLDEN_GAMMA)
    key = mix64(key + wp.uint64(stream) * GOLDEN_GAMMA)
    key = mix64(key + wp.uint64(block) * GOLDEN_GAMMA)
    return mix64(key + wp.uint64(path) * GOLDEN_GAMMA)


@wp.func
def uniform2(state: wp.uint64):
    """Advance a stream: (new state, two uniforms in [0, 1) of 24 bits each)."""
    following = state + GOLDEN_GAMMA
    bits = mix64(following)
    first = float(wp.uint32(bits >> wp.uint64(40))) * TWO_POW_MINUS_24
    second = float(wp.uint32(bits & wp.uint64(0xFFFFFF))) * TWO_POW_MINUS_24
    return following, first, second


@wp.func
def uniform8(start: wp.uint64) -> vec8:
    """Eight uniforms from the four words that follow `start` in a stream."""
    out = vec8()
    state = start
    for pair in range(4):
        state, u, v = uniform2(state)
        out[2 * pair] = u
        out[2 * pair + 1] = v
    return out


@wp.func
def kronecker_coordinate(index: int, step: int, shift: float) -> float:
    """Index * step / 2**32 + shift modulo 1; the product is exact on every machine."""
    product = wp.uint32(index) * wp.uint32(step)
    value = float(product >> wp.uint32(8)) * TWO_POW_MINUS_24 + shift
    if value >= 1.0:
        value = value - 1.0
    return wp.min(value, 0.99999994)


@wp.func
def kronecker(index: int, shift: vec8) -> vec8:
    """Point of a shifted Kronecker sequence (Niederreiter 1992, section 3.1).

    The first step is the fraction of the golden ratio; the others were searched, since square
    roots of primes hold a trap: 6 sqrt(13) - 2 sqrt(11) is nearly a whole number.
    """
    out = vec8()
    out[0] = kronecker_coordinate(index, STEP_0, shift[0])
    out[1] = kronecker_coordinate(index, STEP_1, shift[1])
    out[2] = kronecker_coordinate(index, STEP_2, shift[2])
    out[3] = kronecker_coordinate(index, STEP_3, shift[3])
    out[4] = kronecker_coordinate(index, STEP_4, shift[4])
    out[5] = kronecker_coordinate(index, STEP_5, shift[5])
    out[6] = kronecker_coordinate(index, STEP_6, shift[6])
    out[7] = kronecker_coordinate(index, STEP_7, shift[7])
    return out


@wp.func
def henyey_greenstein(g: float, cosine: float) -> float:
    """Phase function [1/sr] (Henyey and Greenstein 1941, eq. 2), normalised over the sphere."""
    d = wp.max(1.0 + g * g - 2.0 * g * cosine, 1.0e-12)
    return (1.0 - g * g) / (2.0 * TWO_PI * d * wp.sqrt(d))


@wp.func
def henyey_greenstein_log_derivative(g: float, cosine: float) -> float:
    """D ln p / d g of the Henyey-Greenstein phase function."""
    d = wp.max(1.0 + g * g - 2.0 * g * cosine, 1.0e-12)
    return -2.0 * g / (1.0 - g * g) - 3.0 * (g - cosine) / d


@wp.func
def sample_henyey_greenstein(g: float, u: float) -> float:
    """Cosine of the scattering angle from one uniform (Witt 1977, eq. 19)."""
    if wp.abs(g) < 1.0e-3:
        # the closed form cancels here; this is its series to second order in g
        c = 1.0 - 2.0 * u
        return wp.clamp(-(c - 1.5 * g * (1.0 - c * c)), -1.0, 1.0)
    f = (1.0 - g * g) / (1.0 - g + 2.0 * g * u)
    return wp.clamp((1.0 + g * g - f * f) / (2.0 * g), -1.0, 1.0)


@wp.func
def phase_function(first_g: float, share: float, second_g: float, cosine: float) -> float:
    """Two-term Henyey-Greenstein [1/sr]: (1 - share) HG(first_g) + share HG(second_g)."""
    value = henyey_greenstein(first_g, cosine)
    if share > 0.0:
        value = (1.0 - share) * value + share * henyey_greenstein(second_g, cosine)
    return value


@wp.func
def phase_log_derivative(first_g: float, share: float, second_g: float, cosine: float) -> float:
    """D ln p / d g at a fixed second lobe, g = (1 - share) first_g + share second_g."""
    slope = henyey_greenstein_log_derivative(first_g, cosine)
    if share > 0.0:
        first = henyey_greenstein(first_g, cosine)
        slope = slope * first / phase_function(first_g, share, second_g, cosine)
    return slope


@wp.func
def sample_phase(first_g: float, share: float, second_g: float, u: float) -> float:
    """Cosine of the scattering angle from one uniform, which also chooses the lobe."""
    g = first_g
    v = u
    if share > 0.0:
        if u < share:
            g = second_g
            v = u / share
        else:
            v = (u - share) / (1.0 - share)
    return sample_henyey_greenstein(g, v)


@wp.func
def turn(direction: wp.vec3, cosine: float, azimuth: float) -> wp.vec3:
    """A unit vector at a given angle to `direction` (basis of Duff et al. 2017)."""
    sine = wp.sqrt(wp.max(0.0, 1.0 - cosine * cosine))
    sign = 1.0
    if direction[2] < 0.0:
        sign = -1.0
    a = -1.0 / (sign + direction[2])
    b = direction[0] * direction[1] * a
    x = sine * wp.cos(azimuth)
    y = sine * wp.sin(azimuth)
    tangent = wp.vec3(1.0 + sign * direction[0] * direction[0] * a, sign * b, -sign * direction[0])
    bitangent = wp.vec3(b, sign + direction[1] * direction[1] * a, -direction[1])
    return wp.normalize(tangent * x + bitangent * y + direction * cosine)


@wp.func
def turn_upright(direction: wp.vec3, cosine: float, azimuth: float) -> wp.vec3:
    """A unit vector at a given angle to `direction`, highest at azimuth 0 and lowest at pi."""
    level = wp.sqrt(direction[0] * direction[0] + direction[1] * direction[1])
    if level < 1.0e-3:
        return turn(direction, cosine, azimuth)
    sine = wp.sqrt(wp.max(0.0, 1.0 - cosine * cosine))
    tangent = wp.vec3(
        -direction[2] * direction[0] / level, -direction[2] * direction[1] / level, level
    )
    side = wp.vec3(-direction[1] / level, direction[0] / level, 0.0)
    return wp.normalize(
        tangent * (sine * wp.cos(azimuth)) + side * (sine * wp.sin(azimuth)) + direction * cosine
    )


@wp.func
def cosine_cone(sine_half_angle: float, u: float, v: float) -> wp.vec3:
    """Direction around +z, uniform in projected solid angle, within a cone."""
    sine = sine_half_angle * wp.sqrt(u)
    azimuth = TWO_PI * v
    return wp.vec3(
        sine * wp.cos(azimuth), sine * wp.sin(azimuth), wp.sqrt(wp.max(0.0, 1.0 - sine * sine))
    )


@wp.func
def uniform_disc(radius: float, u: float, v: float) -> wp.vec3:
    """Point of the plane z = 0, uniform on a disc."""
    r = radius * wp.sqrt(u)
    azimuth = TWO_PI * v
    return wp.vec3(r * wp.cos(azimuth), r * wp.sin(azimuth), 0.0)


@wp.func
def fresnel(n1: float, n2: float, cos1: float):
    """Unpolarised Fresnel reflectance and the cosine behind the interface.

    Returns (R, cos2); R = 1 and cos2 = 0 at total internal reflection.
    """
    ratio = n1 / n2
    sin2_squared = ratio * ratio * (1.0 - cos1 * cos1)
    if sin2_squared >= 1.0:
        return 1.0, 0.0
    cos2 = wp.sqrt(1.0 - sin2_squared)
    s = (n1 * cos1 - n2 * cos2) / (n1 * cos1 + n2 * cos2)
    p = (n1 * cos2 - n2 * cos1) / (n1 * cos2 + n2 * cos1)
    return 0.5 * (s * s + p * p), cos2


@wp.kernel
def sample_kernel(routine: int, parameter: float, seed: wp.uint64, out: wp.array(dtype=wp.vec3)):
    """Draws of one sampling routine, for the chi-square tests: 0 HG, 1 cone, 2 disc, 3 turn."""
    i = wp.tid()
    state = stream_start(seed, 0, 0, i)
    state, u, v = uniform2(state)
    if routine == 0:
        out[i] = wp.vec3(sample_henyey_greenstein(parameter, u), v, 0.0)
    elif routine == 1:
        out[i] = cosine_cone(parameter, u, v)
    elif routine == 2:
        out[i] = uniform_disc(parameter, u, v)
    else:
        axis = wp.normalize(wp.vec3(0.3, -0.5, parameter))
        cosine = 1.0 - 2.0 * u
        turned = turn(axis, cosine, TWO_PI * v)
        out[i] = wp.vec3(cosine, wp.dot(turned, axis), v)


@wp.func
def on_background(disc: int, half_x: float, half_y: float, x: float, y: float) -> bool:
    """Whether a point of the background plane lies on a background."""
    if disc == 1:
        return (x * x) / (half_x * half_x) + (y * y) / (half_y * half_y) <= 1.0
    return wp.abs(x) <= half_x and wp.abs(y) <= half_y
