"""Is this receiver accepted? On the bench of bench.toml, or on a real one with --bench lab.toml."""

import pytest

from belahil.errors import InterlockRefused
from belahil.stimuli import Sine
from belahil.values import WindowRequest


def test_the_receiver_keeps_its_limits(belahil_run):
    sweep = {"amplitudes_vpp": [0.03], "frequencies_hz": [1e6, 5e6, 9e6, 13e6, 17e6, 21e6, 25e6]}
    characterized = belahil_run("characterize", codes=[4], **sweep)
    (row,) = characterized.results["gain_codes"]
    assert row["cutoff"]["standard_uncertainty"] < 20e3


def test_a_sine_comes_back_amplified(bench):
    sine = Sine(frequency_hz=1e6, amplitude_vpp=0.05)
    window = bench.measure(sine, WindowRequest(shot=0, gain_code=4)).window
    assert window.saturated == 0
    assert window.volts.std() * 8**0.5 == pytest.approx(0.05 * 5.2, rel=0.02)


def test_too_much_is_never_played(bench):
    with pytest.raises(InterlockRefused, match="max_vpp"):
        bench.measure(Sine(frequency_hz=1e6, amplitude_vpp=0.5), WindowRequest(shot=0))


@pytest.mark.hardware
def test_the_laser_of_the_laboratory_does_not_disturb(belahil_run):
    belahil_run("noise", codes=[4], limits={"input_noise_rms_v": (0.0, 0.3e-3)})
