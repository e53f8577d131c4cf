"""The report of a run: one HTML page that stands alone and shows what a procedure drew."""

from belahil.report.figures import save_figures
from belahil.report.page import material, remake, write_page

__all__ = ["material", "remake", "save_figures", "write_page"]
