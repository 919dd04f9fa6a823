"""Parts of small chapters, for the tests of what becomes of a chapter."""

HEADER = """\
# ---
# jupyter:
#   kernelspec: {display_name: Python 3, language: python, name: python3}
# ---
"""
CLAIM = "# %%\nfrom pypose_lite.teaching.claims import claim\nclaim('a', {}, below=1, unit='m')\n"
PROSE = "# %% [markdown]\n# It is 0.21 m.\n"
ERROR = "# %%\n1 / 0\n"
FIGURE = """\
# %% [markdown]
# # Look
# %%
from IPython.display import HTML
HTML("<img src='x'>")
"""
