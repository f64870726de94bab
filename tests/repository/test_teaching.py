"""The term of teaching.md: sheets and stars of a week are those of what is handed in."""

import re

import pytest
import sheet
from workbook import BOOK

PAGE = (sheet.ROOT / "tests" / "course" / "teaching.md").read_text("utf-8")
ROWS = [line.strip("| ").split(" | ") for line in re.findall(r"^\| \d+ .*", PAGE, re.MULTILINE)]
HAND_IN = {week: cells[1] for week, *cells in ROWS[:12]}  # in class, hand in
SHEETS = {week: cells for week, *cells in ROWS[12:]}  # --only, -k, stars of pytest, more stars


@pytest.mark.parametrize("week", SHEETS)
def test_a_week_s_sheet_empties_and_grades_what_is_handed_in(week):
    only, chosen, stars, _ = (cell.strip("`") for cell in SHEETS[week])
    names = re.findall(r"\w+", only)
    wanted = [name for name in re.findall(r"`(\w+)`", HAND_IN[week]) if name in BOOK]
    assert names == wanted, "--only must name the exercises that are handed in"
    assert chosen.strip('"—') == " or ".join(names), "-k must grade what --only empties"
    assert int(stars) == sum(BOOK[name].stars for name in names), "pytest prints others"


def test_the_full_marks_are_the_sum_of_all_weeks():
    stars = [int(cell.split(":")[0]) for row in SHEETS.values() for cell in row[2:]]
    assert f"{sum(stars)} stars" in PAGE, f"all weeks together give {sum(stars)} stars"
