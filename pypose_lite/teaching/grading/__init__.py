"""Grading: the checks of a lab, held against what a student handed in.

``key`` says what is graded and with which numbers, ``grade`` runs a submission in a process of its
own and returns verdicts, ``worker`` is that process, ``trusted`` undoes what a submission has
changed there. Three adapters hand the verdicts on: ``with_nbgrader``, ``with_otter`` (and so
Gradescope), and ``with_pytest``; ``forms`` writes them as JSON for PrairieLearn and Classroom 50.

The notebook's own outputs and checks are never read. What is not defended: code that is written to
attack the grader from within its process, or the computer that it runs on. For that, run the
grader in a container.
"""

from .grade import grade
from .key import Key, Task

__all__ = ["Key", "Task", "grade"]
