"""The site of a book: executing, filling in, folding, building, and the scoreboard of its claims.

``python -m pypose_lite.teaching.site build`` builds the site of the folder where it is called, and
``... new NAME`` begins a tutorial. A book is a folder of jupytext files, with or without
``_toc.yml``, ``_config.yml`` and ``references.bib``; where there is a folder ``book``, they are in
that. Nothing here needs torch.
"""
