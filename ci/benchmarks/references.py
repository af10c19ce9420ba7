"""What anyone would write first, in numpy: the other side of every ratio."""

import numpy as np


def field(model, weights, points, chunk=64):
    """Complex128 field of pistons in a lossy medium; the chunk is the fastest on most machines."""
    from scipy.special import j1

    array, k = model.array, model.wavenumber
    radius = model.transducer.directivity.radius_m
    strength = np.sqrt(2.0) * model.transducer.source_strength_pa_m
    result = np.empty(len(points), dtype=complex)
    for start in range(0, len(points), chunk):
        offset = points[start : start + chunk, None, :] - array.positions_m
        r = np.sqrt((offset * offset).sum(axis=-1))
        cosine = (offset * array.normals).sum(axis=-1) / r
        x = np.maximum(k * radius * np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0)), 1e-9)
        gain = np.where(cosine >= 0.0, 2.0 * j1(x) / x, 0.0)
        waves = gain / r * np.exp((1j * k - model.medium.absorption_np_m) * r)
        result[start : start + chunk] = strength * (waves @ weights)
    return result


def direct_kernel(model, weights):
    """Return a function of points: the shortest compiled loop of single precision, each pair alone.

    Parallel elements; sine and cosine, directivity and loss as polynomials; vectorised.
    """
    import numba

    from haptogram.acoustics.field.engines.kernels import COSINE, SINE
    from haptogram.acoustics.field.engines.polynomials import gain_polynomial

    single, one = np.float32, np.float32(1.0)
    s0, s1, s2, s3 = (single(value) for value in SINE)
    c0, c1, c2, c3, c4 = (single(value) for value in COSINE)
    strength = np.sqrt(2.0) * model.transducer.source_strength_pa_m
    d0, d1, d2, d3, d4, d5 = (strength * gain_polynomial(model)).astype(single)
    turns_m, loss = single(1.0 / model.wavelength_m), single(-model.medium.absorption_np_m)
    sx, sy, sz = model.array.positions_m.T.astype(single).copy()
    turns, size = (np.angle(weights) / (2.0 * np.pi)).astype(single), np.abs(weights).astype(single)

    @numba.njit(fastmath=True, error_model="numpy")
    def add(px, py, pz, re, im):
        for i in range(px.size):
            p, q = single(0.0), single(0.0)
            for n in range(sx.size):
                dx, dy, dz = px[i] - sx[n], py[i] - sy[n], pz[i] - sz[n]
                square = dx * dx + dy * dy + dz * dz
                inverse = one / np.sqrt(square)
                r = square * inverse
                c = (dz * inverse) * (dz * inverse)
                gain = ((((d5 * c + d4) * c + d3) * c + d2) * c + d1) * c + d0
                x = loss * r
                lost = one + x * (one + x * (single(0.5) + x * single(1 / 6)))
                t = r * turns_m + turns[n]
                t = t - np.rint(t)
                w = t * t  # sine and cosine of half of the phase
                sine = t * (((s3 * w + s2) * w + s1) * w + s0)
                cosine = (((c4 * w + c3) * w + c2) * w + c1) * w + c0
                level = size[n] * gain * lost * inverse
                p += level * (one - single(2.0) * sine * sine)
                q += level * single(2.0) * sine * cosine
            re[i], im[i] = p, q

    def field(points):
        re, im = np.empty((2, len(points)), single)
        add(*points.T.astype(single).copy(), re, im)
        return re + 1j * im

    return field


def local_grid(centre):
    """The 9 x 9 x 6 = 486 points of a search for the maximum around a guess."""
    lateral, axial = (np.arange(9) - 4) * 1e-3, (np.arange(6) - 2.5) * 2e-3
    grid = np.stack(np.meshgrid(lateral, lateral, axial, indexing="ij"), axis=-1)
    return grid.reshape(-1, 3) + centre


def wide_grid():
    """The 31 x 31 x 14 points of a search with no guess."""
    lateral, axial = np.linspace(-0.06, 0.06, 31), np.linspace(0.1, 0.27, 14)
    return np.stack(np.meshgrid(lateral, lateral, axial, indexing="ij"), axis=-1).reshape(-1, 3)
