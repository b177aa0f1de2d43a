"""Every row of the tables of columns is one that the drift has: one that is missing or wrong fails here."""

from __future__ import annotations

from dataclasses import fields

from companion.comparison import Drift, DriftRow, Expected, Statistic
from companion.present import QUANTITIES, STATISTICS


def test_each_quantity_is_of_the_drift_and_of_what_is_expected() -> None:
    of_drift = {field.name for field in fields(DriftRow)}
    of_expected = {field.name for field in fields(Expected)}
    assert {quantity.attribute for quantity in QUANTITIES} <= of_drift & of_expected
    measured = {name for name in of_drift if name.split("_")[0] in ("attitude", "velocity", "position")}
    assert measured == {quantity.attribute for quantity in QUANTITIES}


def test_each_statistic_has_its_column() -> None:
    assert list(STATISTICS) == [field.name for field in fields(Statistic)]
    assert all(STATISTICS.values()), "a column without a heading"
    columns = {quantity.column(statistic) for quantity in QUANTITIES for statistic in STATISTICS}
    assert columns <= Drift("", "", "", ()).to_dict().keys()
