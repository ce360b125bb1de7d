import pytest

from v3studio.gui.pages.report_table import Sorting

NAMES = ["cam10", "cam2", "cam1", "cam3"]
COLUMNS = {"error px": ["0.40", "from file", "1.20", "0.40"], "coverage": ["50%", "", "9%", "100%"]}
COLUMNS["matches fit"] = ["98% of 611", "", "100% of 8", "9% of 805"]


@pytest.mark.parametrize(
    ("clicks", "order"),
    [
        (["error px"], ["cam1", "cam10", "cam3", "cam2"]),
        (["error px"] * 2, ["cam10", "cam3", "cam1", "cam2"]),
        (["coverage"], ["cam3", "cam10", "cam1", "cam2"]),
        (["error px", "coverage", "coverage"], ["cam1", "cam10", "cam3", "cam2"]),
        (["matches fit"], ["cam1", "cam10", "cam3", "cam2"]),
        (["camera"], ["cam1", "cam2", "cam3", "cam10"]),
        (["camera"] * 2, ["cam10", "cam3", "cam2", "cam1"]),
        (["focal px"], NAMES),
    ],
)
def test_clicks_on_titles_sort(clicks: list[str], order: list[str]) -> None:
    """Figures by value, worst first; rows without one last either way; a column that is gone changes nothing."""
    sorting = Sorting()
    for title in clicks:
        sorting = sorting.clicked(title)
    assert [NAMES[row] for row in sorting.order(NAMES, COLUMNS)] == order
