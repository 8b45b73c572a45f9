"""Compares irradiance at the same points by two path tracers, and prints a table.

    python compare.py OURS.json THEIRS.json

Differences are relative to the second file's values, of luminance (Rec. 709) and of each channel. The third block of
columns is how large a difference the noise of both explains: one standard error of the difference, relative too.
Ends with 1 if the mean difference of luminance is above 2 %, or more than one point in a hundred differs by more than
2 % and by more than four standard errors.
"""

import json
import sys

import numpy as np

WEIGHTS = np.array([0.2126, 0.7152, 0.0722])
BOUND = 0.02


def table(ours, theirs, what):
    a, b = (np.array([p[what] for p in side["points"]]) for side in (ours, theirs))
    ea, eb = (np.array([p[what + "Error"] for p in side["points"]]) for side in (ours, theirs))
    worst = 0
    for name, weights in [
        ("luminance", WEIGHTS),
        ("red", np.array([1, 0, 0])),
        ("green", np.array([0, 1, 0])),
        ("blue", np.array([0, 0, 1])),
    ]:
        x, y = a @ weights, b @ weights
        # The channels of one sample rise and fall together.
        noise = np.hypot(ea @ weights, eb @ weights)
        # Where no light comes, there is nothing to be relative to.
        lit = y > 1e-3 * y.mean()
        dark = np.abs(x - y)[~lit].max(initial=0)
        x, y, noise = x[lit], y[lit], noise[lit]
        off = np.abs(x - y) / y
        bias = (x.sum() - y.sum()) / y.sum()
        beyond = np.sum((off > BOUND) & (off > 4 * noise / y)) / len(off)
        percent = lambda v: f"{100 * v:.2f} %"
        print(
            f"| {what} | {name} | {len(off)} | {percent(bias)} | {percent(off.mean())} | "
            f"{percent(np.percentile(off, 95))} | {percent(off.max())} | {percent((noise / y).mean())} | "
            f"{percent((noise / y).max())} | {percent(np.sum(off > BOUND) / len(off))} | {dark:.3g} |"
        )
        if name == "luminance":
            worst = max(worst, off.mean() / BOUND, beyond / 0.01)
    return worst


def main():
    ours, theirs = (json.load(open(path)) for path in sys.argv[1:3])
    for side in (ours, theirs):
        print(f"{side['by']}: {side['samples']} samples a point, {side['seconds']:.0f} s")
    print()
    print(
        "| light | of | lit points | difference of sums | mean | 95 % below | max | noise, mean | noise, max "
        "| beyond 2 % | most where dark, lux |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    if max(table(ours, theirs, what) for what in ("direct", "irradiance")) > 1:
        sys.exit(1)


main()
