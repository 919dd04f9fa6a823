"""A Sphinx extension: citations by author and year, as in plain text."""

from collections import Counter
from dataclasses import dataclass, field
from string import ascii_lowercase

from pybtex.plugin import register_plugin
from pybtex.style.formatting.unsrt import Style as Unsorted
from pybtex.style.labels import BaseLabelStyle
from sphinxcontrib.bibtex.plugin import register_plugin as register_sphinx_plugin
from sphinxcontrib.bibtex.style.referencing import BracketStyle
from sphinxcontrib.bibtex.style.referencing.author_year import AuthorYearReferenceStyle

from .plain import authors_and_year


def round_brackets() -> BracketStyle:
    """A citation stands in parentheses."""
    return BracketStyle(left="(", right=")")


class Labels(BaseLabelStyle):
    """What stands before an entry of the bibliography: ``Kalman, 1960a``."""

    def format_labels(self, entries):
        """Yields a label an entry; a letter tells those of one author and year apart."""
        labels = [", ".join(authors_and_year(entry)) for entry in entries]
        count, seen = Counter(labels), Counter[str]()
        for label in labels:
            yield label + (ascii_lowercase[seen[label]] if count[label] > 1 else "")
            seen[label] += 1


class Entries(Unsorted):
    """The entries of the bibliography, by author and year."""

    default_label_style = "book"
    default_sorting_style = "author_year_title"


@dataclass
class References(AuthorYearReferenceStyle):
    """The citations in the text."""

    bracket_parenthetical: BracketStyle = field(default_factory=round_brackets)
    bracket_textual: BracketStyle = field(default_factory=round_brackets)


def setup(app):
    """Registers the styles under the name ``book``."""
    register_plugin("pybtex.style.labels", "book", Labels)
    register_plugin("pybtex.style.formatting", "book", Entries)
    register_sphinx_plugin("sphinxcontrib.bibtex.style.referencing", "book", References)
    return {"parallel_read_safe": True}
