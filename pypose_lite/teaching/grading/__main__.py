"""``python -P -m pypose_lite.teaching.grading key.json 03_mpc.ipynb``: a submission's verdicts.

``--form prairielearn --to results.json`` writes them for a platform, too.
"""

import argparse
import json
from pathlib import Path

from .forms import FORMS
from .grade import grade
from .key import Key


def main() -> None:
    """Grades what the command line names."""
    parser = argparse.ArgumentParser(prog="python -P -m pypose_lite.teaching.grading")
    parser.add_argument("key", type=Path, help="the lab's key, made by `make homework`")
    parser.add_argument("submission", type=Path, help="the student's notebook")
    parser.add_argument("--form", choices=FORMS, default="prairielearn", help="of the JSON")
    parser.add_argument("--to", type=Path, help="the file to write as JSON")
    options = parser.parse_args()
    key = Key.read(options.key)
    verdicts = grade(options.submission, key)
    if options.to:
        options.to.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(FORMS[options.form](key, verdicts), indent=1)
        options.to.write_text(text + "\n", encoding="utf-8")
    for verdict in verdicts:
        print(verdict)
    print(f"{sum(v.points for v in verdicts)} of {sum(v.out_of for v in verdicts)} points")


if __name__ == "__main__":
    main()
