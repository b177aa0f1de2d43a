"""The best estimate of a flight from its sensors alone, and how noisy they are. Pure: imports model and strapdown."""

from companion.estimation.aiding_sensors import HEIGHTS
from companion.estimation.aiding_sensors import SENSORS as AIDING_SENSORS
from companion.estimation.allan import AllanDeviation, Coefficient, NoiseFigures, allan_deviation, noise_figures
from companion.estimation.axes import Reading, motion_between, other_reading
from companion.estimation.chi_square import chi_square
from companion.estimation.differences import in_blocks
from companion.estimation.earth_field import TurnedCompass, field_at, righted, turned_compasses
from companion.estimation.evidence import fault_of_size, harmful, probabilities
from companion.estimation.hypotheses import (
    AIDING,
    HYPOTHESES,
    Hypothesis,
    Size,
    hypothesis_of,
    main_axis,
    turn_of_the_field,
)
from companion.estimation.losses import clip_counters, restored
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
from companion.estimation.noise_density import (
    Sampling,
    WhiteNoise,
    between_samples,
    confirmed_sampling,
    folded_gain,
    quantisation_bound,
    sampling_of,
    white_noise,
)
from companion.estimation.readings import at_rest
from companion.estimation.result import allowing
from companion.estimation.search import times_of_change
from companion.estimation.shapes import SLOPED, activation
from companion.estimation.smoother import Effort, smooth
from companion.estimation.spectrum import (
    Peak,
    Spectrum,
    Vibration,
    folded_onto,
    imu_spectrum,
    peaks,
    stretches,
    vibration,
)
