#!/usr/bin/env python3
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
"""Draws what accessvdb_bench_rolling_flight printed: memory and time of a step along the way, as an SVG.

    tools/flight_picture.py OUTPUT.txt PICTURE.svg [LIMIT_MB]

Only the standard library is needed.
"""
import sys

WIDTH, LEFT, RIGHT = 760, 70, 150
PANELS = (  # title, top, height, lines: name, column of the table, colour
    ("memory of the process, MB", 30, 220, (("most so far", 5, "#c44e52"), ("now", 4, "#4c72b0"), ("tiles, counted", 3, "#55a868"))),
    ("a step, ms", 300, 120, (("median", 6, "#4c72b0"),)),
)


def rows_of(path):
    """The table's rows as numbers: m, tiles, in memory, counted, RSS, peak, median, p99, most, saved, loaded, points."""
    rows = []
    with open(path, encoding="utf-8") as text:
        for line in text:
            words = line.replace("|", " ").split()
            if len(words) >= 12 and all(word.isdigit() for word in words[:12]):
                rows.append([int(word) for word in words[:12]])
    return rows


def step_of(most):
    """A round distance between lines of the grid."""
    for power in (1, 10, 100, 1000):
        for step in (1, 2, 5):
            if most <= 5 * step * power:
                return step * power
    return most


def panel(rows, title, top, height, lines, limit):
    most = max([row[column] for row in rows for _, column, _ in lines] + ([limit] if limit else []))
    step, reach = step_of(most), rows[-1][0]
    most = step * -(-most // step)
    x = lambda metres: LEFT + (WIDTH - LEFT - RIGHT) * metres / reach
    y = lambda value: top + height * (1 - value / most)
    yield f'<text x="{LEFT}" y="{top - 10}" font-weight="bold">{title}</text>'
    for value in range(0, most + 1, step):
        yield f'<path d="M{LEFT} {y(value):.1f}H{WIDTH - RIGHT}" stroke="#ddd"/>'
        yield f'<text x="{LEFT - 8}" y="{y(value) + 4:.1f}" text-anchor="end">{value}</text>'
    for metres in range(0, reach + 1, step_of(reach)):
        yield f'<text x="{x(metres):.1f}" y="{top + height + 18}" text-anchor="middle">{metres} m</text>'
    names = []
    for name, column, colour in lines:
        way = "L".join(f"{x(row[0]):.1f} {y(row[column]):.1f}" for row in rows)
        yield f'<path d="M{way}" fill="none" stroke="{colour}" stroke-width="2"/>'
        names.append((y(rows[-1][column]), name, colour))
    if limit:
        yield f'<path d="M{LEFT} {y(limit):.1f}H{WIDTH - RIGHT}" stroke="#222" stroke-dasharray="6 4"/>'
        names.append((y(limit), "limit", "#222"))
    at = -100
    for where, name, colour in sorted(names):
        at = max(where + 4, at + 15)
        yield f'<text x="{WIDTH - RIGHT + 8}" y="{at:.1f}" fill="{colour}">{name}</text>'


def main():
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    rows = rows_of(sys.argv[1])
    if not rows:
        sys.exit(f"flight_picture: error: {sys.argv[1]} has no rows of accessvdb_bench_rolling_flight")
    limit = int(sys.argv[3]) if len(sys.argv) == 4 else None
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="460" font-family="sans-serif" font-size="13">',
             f'<rect width="{WIDTH}" height="460" fill="white"/>']
    for number, (title, top, height, lines) in enumerate(PANELS):
        parts.extend(panel(rows, title, top, height, lines, limit if number == 0 else None))
    with open(sys.argv[2], "w", encoding="utf-8") as out:
        out.write("\n".join(parts + ["</svg>"]) + "\n")


if __name__ == "__main__":
    main()
