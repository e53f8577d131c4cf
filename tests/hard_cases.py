"""Hard cases with names: inputs on which a plain method gives a wrong number without a word.

Every method that claims a case runs it in `test_hard_cases.py` against a slow, obvious reference.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class HardCase:
    """One row.

    Parameters
    ----------
    name : str
        For ever; tests and reports cite it.
    case : str
        The input.
    plain : str
        What a plain method makes of it.
    limit : float
        The largest error allowed, as `meaning` says.
    meaning : str
        Of the limit.
    reference : str
        What the result is compared with.
    """

    name: str
    case: str
    plain: str
    limit: float
    meaning: str
    reference: str


HARD_CASES = {
    one.name: one
    for one in (
        HardCase(
            "H21",
            "a sample that is not a number",
            "the sine fit returns nan without a word",
            1e-10,
            "relative amplitude error",
            "the fit without that sample",
        ),
        HardCase(
            "H23",
            "a sine at 0, f_s/2 or f_s",
            "an amplitude that depends on the phase, 0 to the true one",
            1e3,
            "largest condition number that is not flagged",
            "singular values of the columns",
        ),
        HardCase(
            "H24",
            "less than a cycle in the record: 1, 0.5, 0.25, 0.1, 0.001",
            "errors up to 6 V for 30 mV",
            5.0,
            "error in standard uncertainties; flagged below half a cycle",
            "Cramer-Rao bound",
        ),
        HardCase(
            "H25",
            "two converters that differ by 1 %, a sine at or near f_s/4 and f_s/2",
            "an error of 0.5 % that depends on the phase",
            2e-6,
            "relative amplitude error, or flagged",
            "a record written down with that mismatch",
        ),
        HardCase(
            "H26",
            "a clock 1 to 250 ppm off",
            "up to 37 % too small at 10 MHz",
            1e-9,
            "relative amplitude error with four parameters",
            "the sinc of the phase drift for three parameters",
        ),
        HardCase(
            "H27",
            "a sine between bins, for a fit that starts on one",
            "no convergence from more than a bin away",
            1.2,
            "spread of the frequency over the bound",
            "Cramer-Rao bound",
        ),
        HardCase(
            "H28",
            "an amplitude of 0.3 codes",
            "0 or 0.64 codes without noise",
            0.02,
            "relative bias with 0.5 codes of noise; flagged below",
            "the sine before rounding",
        ),
        HardCase(
            "H29",
            "a sine clipped at 0.8 and 0.5 of its amplitude",
            "11 % and 39 % too small",
            0.0,
            "amplitudes given without a flag",
            "the sine before clipping",
        ),
        HardCase(
            "H30",
            "a record of zeros or of one value",
            "nan, then an error from LAPACK",
            0.0,
            "amplitude, with no weight and no frequency",
            "zero",
        ),
        HardCase(
            "H31",
            "a sweep that ends far below the cut-off",
            "a cut-off of 144 MHz",
            0.2,
            "relative difference of the claimed to the possible uncertainty; flagged at 20 % of the cut-off",
            "Cramer-Rao bound",
        ),
        HardCase(
            "H32",
            "no idea where the cut-off is",
            "-56 kHz, 19 THz or 1355 Hz, depending on the start",
            1e-6,
            "relative difference",
            "a fine grid with golden section",
        ),
        HardCase(
            "H33",
            "one or two gains 20 % too low",
            "0.35 MHz off",
            10e3,
            "error of the cut-off, Hz, with the robust loss",
            "the true cut-off",
        ),
        HardCase(
            "H34",
            "the order of the filter",
            "a good fit by a wrong order, if the sweep ends early",
            3.0,
            "error of the free order in standard uncertainties",
            "the true order",
        ),
    )
}
