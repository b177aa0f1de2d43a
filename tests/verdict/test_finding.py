"""What a finding may be of."""

from __future__ import annotations

import re

import pytest

from companion import estimation
from companion.verdict.finding import KINDS, Cause, Finding, leading_doubt
from tests.recordings import ROOT


def test_there_is_no_finding_of_what_is_not_in_the_table() -> None:
    with pytest.raises(ValueError, match="'gremlins' is no kind of finding"):
        Finding("gremlins", "imu", "error", 0.0, 1.0, "seen", "do this")


def test_everything_that_may_be_explained_may_be_a_finding() -> None:
    assert {kind.name for kind in estimation.HYPOTHESES} <= KINDS.keys()


def test_the_documents_list_them_all() -> None:
    page = (ROOT / "docs" / "json.md").read_text(encoding="utf-8")
    table = page.split("### Kinds of findings")[1].split("\n## ")[0]
    assert dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", table, flags=re.MULTILINE)) == KINDS


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_made_somewhere(kind: str) -> None:
    """By its name, or by that of a sensor or of a quantity and its end."""
    source = "".join(
        path.read_text(encoding="utf-8")
        for folder in ("comparison", "verdict", "estimation")
        for path in (ROOT / "companion" / folder).rglob("*.py")
        if path.name != "finding.py"
    )
    end = kind.partition("_")[2]
    assert f'"{kind}"' in source or f'}}_{end}"' in source


@pytest.mark.parametrize(
    ("probabilities", "leads"), [((None, None), 0), ((0.1, 0.4), 0), ((None, 0.8), 1), ((0.6, 0.7), 1)]
)
def test_what_is_likelier_than_not_leaves_the_verdict_open_before_what_came_first(
    probabilities: tuple[float | None, ...], leads: int
) -> None:
    doubts = [
        Finding("tilt_off", "data", "warning", 10.0 * i, 20.0, "off", "look", cause=cause, undecided=True)
        for i, cause in enumerate(Cause("tilt_off", "autopilot", 0.0, probability=one) for one in probabilities)
    ]
    sure = Finding(
        "vibration",
        "imu",
        "warning",
        0.0,
        1.0,
        "shakes",
        "damp it",
        cause=Cause("vibration", "imu", 0.0, probability=1.0),
    )
    assert leading_doubt([sure, *doubts]) is doubts[leads]
    assert leading_doubt([sure]) is None
