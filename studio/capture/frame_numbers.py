"""Frame numbers in messages."""

from __future__ import annotations


def number_ranges(numbers: list[int]) -> str:
    """Frame numbers as "3, 7-9, 12", cut after six ranges."""
    runs: list[tuple[int, int]] = []
    for number in sorted(numbers):
        if runs and number == runs[-1][1] + 1:
            runs[-1] = (runs[-1][0], number)
        else:
            runs.append((number, number))
    texts = [str(first) if first == last else f"{first}-{last}" for first, last in runs]
    if len(texts) > 6:
        return f"{', '.join(texts[:6])} and more ({len(numbers)} in total)"
    return ", ".join(texts)
