"""The page for teachers says what lessons, labs and checks say."""

import re

import pytest
from submissions import ROOT

from pypose_lite.teaching.checks import chapter, find
from pypose_lite.teaching.site import exercises as tool
from pypose_lite.teaching.site import syllabus
from pypose_lite.teaching.site.needs import needs_in

PAGE = (ROOT / "book" / "teaching.md").read_text(encoding="utf-8")
LABS = {path.stem: path.read_text("utf-8") for path in sorted(ROOT.glob("solutions/[0-9]*.py"))}
PLANS = {"six": syllabus.SIX, "twelve": syllabus.TWELVE}


def cells(row):
    return [cell.strip() for cell in row.strip("|").split("|")]


def test_every_table_of_the_page_is_filled_in():
    assert set(re.findall(r"<!-- syllabus: (\w+) -->", PAGE)) == set(syllabus.TABLES)
    assert "<!-- syllabus" not in syllabus.filled(PAGE)


@pytest.mark.parametrize("lab", LABS)
def test_the_overview_has_the_minutes_that_the_lab_itself_says(lab):
    row = cells(next(r for r in syllabus.overview().splitlines() if f"({lab}.py)" in r))
    minutes = [int(found) for found in tool.MINUTES.findall(LABS[lab])]
    assert [row[3], row[4]] == [str(len(minutes)), str(sum(minutes))]
    text = (ROOT / f"book/{lab}.py").read_text(encoding="utf-8")
    said = re.search(r"Take about (\d+)\s+(?:# )?minutes", text)
    assert row[2] == said[1]


def test_each_lesson_has_goals_and_needs_earlier_ones_only():
    for page in syllabus.lessons():
        assert len(re.findall("^- ", syllabus.goals_of(page), re.MULTILINE)) >= 3
        numbers = [syllabus.number_of(other) for other in syllabus.needs_of(page)]
        assert all(number < syllabus.number_of(page) for number in numbers)
    assert [syllabus.number_of(page) for page in syllabus.needs_of("07_all_together")] == [3, 4, 6]


@pytest.mark.parametrize("plan", PLANS)
def test_a_plan_teaches_what_is_needed_before_it_is_needed(plan):
    taught = set()
    for numbers, asked, _ in PLANS[plan]:
        pages = [page for page in syllabus.lessons() if syllabus.number_of(page) in numbers]
        taught |= set(numbers)
        for page in pages:
            needed = {syllabus.number_of(other) for other in syllabus.needs_of(page)}
            assert needed <= taught
        chosen = asked.split() if asked != "all" else []
        assert all(find(number) and int(number.split(".")[0]) in taught for number in chosen)
        for text in LABS.values():
            for number, others in needs_in(text).items():
                assert number not in chosen or set(others) <= set(chosen)


def test_a_week_has_the_minutes_and_points_of_its_exercises():
    row = cells(syllabus.weeks(syllabus.SIX).splitlines()[4])
    chosen = [find(number) for number in row[3].split(", ")]
    assert row[4:6] == [str(sum(e.minutes for e in chosen)), str(sum(e.points for e in chosen))]
    everything = cells(syllabus.weeks(syllabus.TWELVE).splitlines()[3])
    assert everything[3:5] == ["all", str(sum(exercise.minutes for exercise in chapter(2)))]


def test_an_exercise_needs_another_one_whose_names_it_reads():
    lab = (
        "# %%\nimport torch\ncar = 1\n\n"
        "# %% [markdown]\n# ## Exercise 9.1: A\n\n# %%\ndef first(x):\n    return x\n\n"
        "# %% [markdown]\n# ## Exercise 9.2: B\n\n# %%\nhalf = first(car)\n\n"
        "# %% [markdown]\n# ## Exercise 9.3: C\n\n# %%\ndef third(half):\n    return half + car\n"
    )
    assert needs_in(lab) == {"9.2": ["9.1"]}
