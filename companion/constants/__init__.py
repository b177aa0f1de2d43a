"""The hand-set numbers of `noise`, `estimation`, `comparison` and `verdict`, each in one table. A module is a table:

`healthy` what parts in order show, `harm` from when on an error matters, `priors` how often, `num` how the estimate and
the drift are computed, `check` how readings are checked. SI, or the unit in the name; a row whose comment names no
source is engineering judgement. Rows of more than a number stand where they are read: kinds of fault in
`estimation/hypotheses.py`, aiding sensors in `estimation/aiding_sensors.py`, constants of a flight in
`estimation/model.py`.
"""
