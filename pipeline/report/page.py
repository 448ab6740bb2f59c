"""The page: one HTML file that needs nothing beside it."""

from markupsafe import Markup

from pipeline.report.layout.rendering import REPORT, environment, one_file
from pipeline.report.layout.wording import plain_number
from pipeline.report.sections import Page, Section, sections_of

TEMPLATE = "page.html"


def report_page(page: Page) -> str:
    """The report as one self-contained HTML document."""
    templates, study = environment(REPORT), page.frames.study
    shared_values = {
        "study": study,
        "frames": page.frames,
        "results": page.results,
        "pictures": page.pictures,
        "level": plain_number(100 * study.metrics.confidence),
    }

    def content(section: Section) -> Markup:
        source = templates.from_string(f"{section.source}\n")  # a template loses its last line break
        return Markup(source.render(shared_values | dict(section.values(page))))

    parts = [(section, content(section)) for section in sections_of(page.frames)]
    contents = [(section.name, section.title) for section, _ in parts]
    return one_file(templates, TEMPLATE, **shared_values, parts=parts, sections=contents, explorer=page.explorer)
