"""The tables of a scene file: what is there, in numbers and words.

Every key has a default. Those of `Laser` and `Detector` are the preset ``bela``; where they come from, and
which of them are assumed, is in `sim.presets`.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from belahil.strict_toml import NotNegative, Strict

Thermal = Literal["cold", "ambient", "hot"]

# Wide enough for any instrument, narrow enough that no product of them leaves the range of a float.
Fraction = Annotated[float, Meta(ge=1e-6, le=1)]
Length = Annotated[float, Meta(ge=1e-3, le=1e6)]
Angle = Annotated[float, Meta(ge=-0.1, le=0.1)]
Voltage = Annotated[float, Meta(ge=0, le=1e6)]
Current = Annotated[float, Meta(ge=0, le=1)]
Temperature = Annotated[float, Meta(ge=-273.15, le=1000)]
Albedo = Annotated[float, Meta(ge=0, le=10)]


class Laser(Strict, frozen=True):
    """``[laser]``: the pulse that leaves the instrument.

    `preset` and `thermal` name where the values of a scene file's missing keys come from; once there is a
    `Laser` they are labels. In Python, `sim.presets.laser_preset` fills them in.

    Parameters
    ----------
    preset, thermal : str
        Names in `sim.presets`.
    energy_j, wavelength_m : float
        Energy of a pulse; wavelength.
    pulse : {"gaussian", "tailed", "table"}
        Shape in time. "tailed" is a Gaussian of `fwhm_s` convolved with a one-sided exponential of `tail_s`.
    fwhm_s, tail_s : float
        Full width at half maximum of the Gaussian; time constant of the tail (0: none).
    table : str
        File of time in s and relative power, for ``pulse = "table"``.
    beam : {"gaussian", "elliptical", "image"}
        Shape across the beam.
    image : str
        File of the beam's profile, for ``beam = "image"``.
    image_pixel_rad : float
        Angle from one pixel of it to the next.
    divergence_rad : float
        Full angle at 1/e^2 of the peak; of an ellipse, the geometric mean of both axes.
    ellipticity : float
        1 - minor / major axis.
    beam_azimuth_deg : float
        Direction of the major axis, from +x towards +y.
    pointing_rad : tuple of float
        Where the beam points, off nadir, towards +x and +y.
    jitter_rad : tuple of float
        Rms of that from shot to shot. A file may give one number for both.
    energy_jitter : float
        Rms of the energy from shot to shot, relative.
    """

    preset: str = "bela"
    thermal: Thermal = "ambient"
    energy_j: Annotated[float, Meta(ge=1e-12, le=1e3)] = 50e-3
    wavelength_m: Annotated[float, Meta(ge=1e-9, le=1e-3)] = 1064e-9
    pulse: Literal["gaussian", "tailed", "table"] = "tailed"
    fwhm_s: Annotated[float, Meta(ge=1e-12, le=1e-3)] = 5.4e-9
    tail_s: Annotated[float, Meta(ge=0, le=1e-3)] = 3.0e-9
    table: str = ""
    beam: Literal["gaussian", "elliptical", "image"] = "gaussian"
    image: str = ""
    image_pixel_rad: Annotated[float, Meta(ge=1e-9, le=0.01)] = 1e-6
    # A wider beam would need more than the small-angle forms of the footprint.
    divergence_rad: Annotated[float, Meta(ge=1e-7, le=0.01)] = 50e-6
    ellipticity: Annotated[float, Meta(ge=0, le=0.99)] = 0.1
    beam_azimuth_deg: float = 0.0
    pointing_rad: tuple[Angle, Angle] = (0.0, 0.0)
    jitter_rad: tuple[NotNegative, NotNegative] = (1e-6, 1e-6)
    energy_jitter: Annotated[float, Meta(ge=0, le=0.1)] = 0.014


class Detector(Strict, frozen=True):
    """``[detector]``: from the telescope's aperture to the voltage at the cut.

    Parameters
    ----------
    preset : str
        As in `Laser`.
    telescope_radius_m : float
        Of the aperture.
    field_of_view_rad : float
        Half of the cone.
    boresight_rad : tuple of float
        Where the field of view is centred, off nadir, towards +x and +y.
    optical_efficiency, filter_transmission, quantum_efficiency : float
        Of the telescope, the optical filter and the photodiode.
    filter_width_m : float
        Optical pass band.
    bias_v, breakdown_v : float
        Of the avalanche photodiode, the second at `breakdown_reference_c`.
    breakdown_v_per_k, breakdown_reference_c, apd_temperature_c : float
        How the breakdown voltage follows the photodiode's temperature.
    miller_exponent : float
        n of Miller's equation.
    multiplication : float or None
        Gain of the photodiode; None: from Miller's equation.
    excess_noise_exponent : float
        x of the excess noise factor M^x.
    surface_dark_a, bulk_dark_a : float
        Dark currents that are not, and that are, multiplied, where the receiver's dark noise leaves them out.
    feedback_ohm : float
        Effective transimpedance.
    tia_bandwidth_hz : float
        Printed bandwidth; it acts with ``filter = "gaussian"`` only.
    tia_pole_hz : float
        One extra pole of the amplifier before the cut; 0: none.
    """

    preset: str = "bela"
    telescope_radius_m: Annotated[float, Meta(ge=1e-3, le=100)] = 0.10
    field_of_view_rad: Annotated[float, Meta(ge=1e-7, le=0.1)] = 247.5e-6
    boresight_rad: tuple[Angle, Angle] = (0.0, 0.0)
    optical_efficiency: Fraction = 0.84
    filter_transmission: Fraction = 0.85
    filter_width_m: Annotated[float, Meta(ge=1e-15, le=1e-3)] = 2e-9
    quantum_efficiency: Fraction = 0.34
    bias_v: Voltage = 320.0
    # M(320 V) = 48.4 with the exponent below; see "Miller check" in `sim.presets`.
    breakdown_v: Voltage = 391.4255820210866
    breakdown_v_per_k: Annotated[float, Meta(ge=-100, le=100)] = 2.4
    breakdown_reference_c: Temperature = 20.0
    apd_temperature_c: Temperature = 20.0
    miller_exponent: Annotated[float, Meta(ge=0.01, le=100)] = 0.103624
    multiplication: Annotated[float, Meta(ge=1, le=1e9)] | None = None
    excess_noise_exponent: Annotated[float, Meta(ge=0, le=2)] = 0.30
    surface_dark_a: Current = 0.0
    bulk_dark_a: Current = 0.0
    feedback_ohm: Annotated[float, Meta(ge=1e-3, le=1e12)] = 45e3
    tia_bandwidth_hz: Annotated[float, Meta(ge=1, le=1e12)] = 20e6
    tia_pole_hz: Annotated[float, Meta(ge=0, le=1e12)] = 0.0

    @property
    def breakdown_now_v(self) -> float:
        """Breakdown voltage at the photodiode's temperature, V."""
        return self.breakdown_v + self.breakdown_v_per_k * (
            self.apd_temperature_c - self.breakdown_reference_c
        )


class SurfaceTable(Strict, frozen=True):
    """``[surface]``: the ground, and what it reflects.

    The origin of a plane, of relief and of a made grid is where nadir meets the ground.

    Parameters
    ----------
    kind : str
        "plane", "crater", "boulder", "fractal", "multifractal" or "dtm".
    slope_deg, azimuth_deg : float
        Steepest ascent of the plane that carries the relief, and its direction from +x towards +y.
    reflectance : float
        alpha_N, at the laser's wavelength.
    reflectance_map : str
        File of a map that takes its place, on the grid of the surface.
    photometry : {"lommel-seeliger", "lambert", "factor"}
        Radiation factor: 1, the cosine of the incidence, or `radiation_factor`.
    radiation_factor : float
        xi, for ``photometry = "factor"``.
    centre_m : tuple of float
        Of the crater or boulder; on a DTM, where nadir is, from the middle of the grid.
    diameter_m, depth_m, height_m, exponent : float
        Of the crater or boulder; the exponent shapes its profile, see `sim.terrain`.
    rim_height_m : float or None
        Of the crater; None: that of fresh ones.
    hurst, rms_deviation_m, baseline_m : float
        Of a fractal: exponent, and RMS deviation of heights that are one baseline apart.
    alpha, c1 : float
        Of a multifractal: index and codimension of the mean.
    seed : int
        Of a made surface.
    extent_m, spacing_m : float
        Side and grid spacing of a made surface; of a DTM, the side that is read, and the spacing of an array.
    file : str
        GeoTIFF or array, for ``kind = "dtm"``.
    datum_m : float or None
        Height on it that is z = 0; None: its height at nadir.
    """

    kind: Literal["plane", "crater", "boulder", "fractal", "multifractal", "dtm"] = "plane"
    slope_deg: Annotated[float, Meta(ge=0, lt=90)] = 0.0
    azimuth_deg: float = 0.0
    reflectance: Albedo = 0.17
    reflectance_map: str = ""
    photometry: Literal["lommel-seeliger", "lambert", "factor"] = "lommel-seeliger"
    radiation_factor: Albedo = 1.0
    centre_m: tuple[float, float] = (0.0, 0.0)
    diameter_m: Length = 20.0
    depth_m: Length = 3.0
    height_m: Length = 3.0
    exponent: Annotated[float, Meta(ge=1)] = 2.0
    rim_height_m: NotNegative | None = None
    hurst: Annotated[float, Meta(gt=0, lt=1)] = 0.8
    rms_deviation_m: Length = 1.0
    baseline_m: Length = 65.0
    alpha: Annotated[float, Meta(gt=0, le=2)] = 1.8
    c1: NotNegative = 0.1
    seed: Annotated[int, Meta(ge=0)] = 1
    extent_m: Length = 768.0
    spacing_m: Length = 1.5
    file: str = ""
    datum_m: float | None = None


class Noise(Strict, frozen=True):
    """``[noise]``: a term that is not named is not there.

    Parameters
    ----------
    dark_rms_v : float or None
        Dark noise with EMC at the converter, at the scene's gain code, coloured by the receiver's filter.
    dark_windows : str
        Instead: a file of windows recorded from a receiver, see `sim.dark_windows`.
    dark_laser : {"", "off", "firing"}
        Which of them, where the file tells; "": with the laser firing where there are some.
    shot : bool
        Shot noise of the echo.
    """

    dark_rms_v: NotNegative | None = None
    dark_windows: str = ""
    dark_laser: Literal["", "off", "firing"] = ""
    shot: bool = False


class RangeFinderTable(Strict, frozen=True):
    """``[range_finder]``: how the receiver looks for pulses; all assumed, see `sim.rfm`.

    Parameters
    ----------
    template_count : int
        Widths of templates.
    narrowest_s, widest_s : float
        Full widths at half maximum of the first and the last.
    exclusion_samples : int
        No two candidates lie within so many.
    correlation_window_samples : int or None
        Kept round each candidate; None: as the receiver's preset has it.
    refinement_steps : int
        Of the Gaussian fit to them.
    """

    template_count: Annotated[int, Meta(ge=3, le=64)] = 12
    narrowest_s: Annotated[float, Meta(ge=1e-12, le=1e-3)] = 18e-9
    widest_s: Annotated[float, Meta(ge=1e-12, le=1e-3)] = 120e-9
    exclusion_samples: Annotated[int, Meta(ge=0, le=1000)] = 10
    correlation_window_samples: Annotated[int, Meta(ge=4, le=4096)] | None = None
    refinement_steps: Annotated[int, Meta(ge=0, le=100)] = 1


class Sun(Strict, frozen=True):
    """``[sun]``: sunlight on the ground; without the table it is night.

    Parameters
    ----------
    incidence_deg : float
        From the vertical of the ground.
    distance_au : float
        Of the planet from the Sun.
    irradiance_1au_w_per_m3 : float
        Spectral irradiance at 1 au at the laser's wavelength: W per m^2 and m of wavelength.
    """

    incidence_deg: Annotated[float, Meta(ge=0, le=90)] = 0.0
    distance_au: Annotated[float, Meta(ge=1e-3, le=1e3)] = 0.3871
    irradiance_1au_w_per_m3: Annotated[float, Meta(ge=0, le=1e12)] = 0.643e9
