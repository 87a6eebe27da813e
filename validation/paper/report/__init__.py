"""The report on the paper: a `PaperRun` as JSON, as one HTML page, and as a page of the documentation."""

from __future__ import annotations

from tdcr_fe.validation.paper.report.document import to_json
from tdcr_fe.validation.paper.report.page import html
from tdcr_fe.validation.paper.report.write import write_datasets, write_docs, write_report

__all__ = ["html", "to_json", "write_datasets", "write_docs", "write_report"]
