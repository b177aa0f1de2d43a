"""The best estimate of a flight's trajectory from its sensors alone. Pure."""

from companion.estimation.aiding_sensors import HEIGHTS
from companion.estimation.aiding_sensors import SENSORS as AIDING_SENSORS
from companion.estimation.axes import Reading, motion_between, other_reading
from companion.estimation.differences import in_blocks
from companion.estimation.earth_field import TurnedCompass, field_at, righted, turned_compasses
from companion.estimation.evidence import change_probability, fault_of_size, harmful, probabilities
from companion.estimation.hypotheses import (
    AIDING,
    HYPOTHESES,
    Hypothesis,
    Size,
    hypothesis_of,
    main_axis,
    turn_of_the_field,
)
from companion.estimation.model import (
    ATTITUDE,
    CONSTANTS,
    POSITION,
    VELOCITY,
    BestEstimate,
    ConfusionMatrix,
    ConstantErrors,
    Correlation,
    Explained,
    Identifiability,
    ProcessNoise,
    Residuals,
    Rival,
    States,
    corrected,
    without_errors,
)
from companion.estimation.readings import at_rest, receiver_of
from companion.estimation.result import allowing
from companion.estimation.search import times_of_change
from companion.estimation.shapes import SLOPED, activation
from companion.estimation.smoother import Effort, smooth
from companion.model import IntArray
