"""Repetition of the published twin's validation: Sekkat et al., Heliyon (2024).

limits_table, LimitsTable, LimitRow       joint limits compared with the paper's
replay, GestureReport                     the paper's gestures on the twin
paper_gesture, PaperGesture, paper_inconsistencies, GESTURES   the gestures in the paper
check_paper, PaperCheck, save_paper_check   the whole validation of `pepper-kin check paper`
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from pepper_kin.lazy_names import lazily

if TYPE_CHECKING:
    from pepper_kin.paper.check import PaperCheck, check_paper
    from pepper_kin.paper.files import save_paper_check
    from pepper_kin.paper.gesture_replay import GestureReport, replay
    from pepper_kin.paper.table4 import LimitRow, LimitsTable, limits_table
    from pepper_kin.paper.table5 import GESTURES, PaperGesture, paper_gesture, paper_inconsistencies

__all__ = [
    "GESTURES",
    "GestureReport",
    "LimitRow",
    "LimitsTable",
    "PaperCheck",
    "PaperGesture",
    "check_paper",
    "limits_table",
    "paper_gesture",
    "paper_inconsistencies",
    "replay",
    "save_paper_check",
]

__getattr__, __dir__ = lazily(__name__)
