"""Pictures as the notebooks show them: with an alternative text, for those who cannot see them."""

import base64
import html
import io
from dataclasses import dataclass

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

DPI = 110  # of a figure of 7 inches: 770 pixels, the width of the page


@dataclass(frozen=True)
class Picture:
    """A picture that JupyterLab and the page show in the same way.

    ``data`` are its bytes, ``alt`` says in words what it shows, ``format`` is png, jpeg or gif.
    With ``letters`` in it, it is not made smaller on a phone, where it scrolls instead.
    """

    data: bytes
    alt: str
    format: str = "png"
    letters: bool = True

    @property
    def html(self) -> str:
        """The element that holds the picture and its alternative text."""
        code = base64.b64encode(self.data).decode()
        alt = html.escape(" ".join(self.alt.split()))
        kind = "picture" if self.letters else "scene"
        return f'<img class="{kind}" alt="{alt}" src="data:image/{self.format};base64,{code}">'

    def _repr_mimebundle_(self, **_: object) -> dict[str, str]:
        """HTML, since no notebook's own picture format has room for an alternative text."""
        return {"text/html": self.html, "text/plain": f"Figure: {self.alt}"}


def png(figure: Figure, dpi: int = DPI) -> bytes:
    """Returns the figure as PNG bytes, the same ones on every run, and closes it."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    plt.close(figure)
    return buffer.getvalue()
