"""How noisy an IMU is: Allan deviation, spectra, white noise, low-passes, gaps. Pure."""

from companion.model import BoolArray
from companion.noise.allan import AllanDeviation, Coefficient, NoiseFigures, allan_deviation, noise_figures
from companion.noise.chi_square import chi_square
from companion.noise.losses import broken_intervals, clip_counters, lost_by_clipping, lost_in_gaps, restored, undelayed
from companion.noise.noise_density import (
    Aliased,
    Sampling,
    SensorName,
    WhiteNoise,
    aliasing,
    between_samples,
    confirmed_sampling,
    folded_gain,
    quantisation_bound,
    relative_scatter,
    sampling_of,
    scatter_between_samples,
    spectral_noise,
    white_noise,
)
from companion.noise.spectrum import (
    Peak,
    Spectrum,
    Vibration,
    folded_onto,
    imu_spectrum,
    neighbourhoods,
    peaks,
    stretches,
    vibration,
)
