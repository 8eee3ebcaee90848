"""What a person looks at after a fit: PNG pictures, charts and one HTML page; and previews while it
runs.

May import the contract, numpy, Pillow and matplotlib (only while drawing); never the renderer,
Blender or the fit.
"""

from facestage.report.color import to_srgb8
from facestage.report.person_page import write_person_report
from facestage.report.preview import write_preview
from facestage.report.report_data import ReportData
from facestage.report.sequence_film import ShownFrame, blood_picture
from facestage.report.sequence_page import write_sequence_report
from facestage.report.wrinkles_picture import write_wrinkles_picture
from facestage.report.writer import write_report

__all__ = [
    "ReportData",
    "ShownFrame",
    "blood_picture",
    "to_srgb8",
    "write_person_report",
    "write_preview",
    "write_report",
    "write_sequence_report",
    "write_wrinkles_picture",
]
