"""The validation of the published twin made again: Sekkat et al., Heliyon (2024).

limits_table, LimitsTable, LimitRow       joint limits beside those of the paper
replay, GestureReport                     the paper's gestures on the twin
paper_gesture, PaperGesture, paper_inconsistencies, GESTURES   what the paper says of them
check_paper, PaperCheck, save_paper_check   all of it, as `pepper-kin check paper` runs it
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
