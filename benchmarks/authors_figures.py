"""What the authors' own released code makes of the four triplets of 8,192 points.

Their solvers and the settings of their README, one seed, with an exact distance transform and an
exact k-d tree in place of their approximations. Means over the triplets; dynamic and static over
labelled points. Runs differ by several points of Acc5 from seed to seed.
"""

from __future__ import annotations

from collections.abc import Mapping

EPE, ACC5, DYNAMIC, STATIC = "EPE (m)", "Acc5 (%)", "EPE dynamic", "EPE static"
DECIMALS = {EPE: 3, ACC5: 1, DYNAMIC: 3, STATIC: 3}

AUTHORS: Mapping[str, Mapping[str, float]] = {
    "nsfp": {EPE: 0.071, ACC5: 50.7, DYNAMIC: 0.297, STATIC: 0.073},
    "fnsf": {EPE: 0.066, ACC5: 54.5, DYNAMIC: 0.370, STATIC: 0.050},
    "mnsf": {EPE: 0.087, ACC5: 51.5, DYNAMIC: 0.285, STATIC: 0.073},
}


def verdict(
    authors: Mapping[str, float], ours: Mapping[str, float], spreads: Mapping[str, float]
) -> str:
    """Says whether our figures are no worse, and if they are, in what and by how much.

    Args:
        authors: Column to the authors' figure, of one seed.
        ours: Column to our mean over seeds.
        spreads: Column to the standard deviation of ours from seed to seed, NaN if unknown. What
            is worse by less than that could be another seed of theirs.
    """
    within, worse = [], []
    for column, theirs in authors.items():
        lost = theirs - ours[column] if column == ACC5 else ours[column] - theirs
        # Their figures are rounded; a difference of less than half a digit is none.
        if lost >= 0.5 * 10.0 ** -DECIMALS[column]:
            text = f"{column.split(' (')[0]} by {lost:.{DECIMALS[column]}f}"
            (within if lost <= spreads[column] else worse).append(text)
    if worse:
        return f"worse in {', '.join(worse)}"
    return f"no worse, within the seeds ({', '.join(within)})" if within else "no worse"
