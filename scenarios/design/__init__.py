"""Design studies: what a set-up will tell and cost, before a part is bought.

`study(goal, parts)` looks for the cheapest parts and protocol that meet a goal's targets, by Fisher
information with the tolerances of cheap parts, says what limits them and what more money buys, and
simulates the leading candidates in full. docs/design.md.
"""

from scenarios.design.candidate import Candidate, Space
from scenarios.design.goal import Goal, builtin_goals, load_goal
from scenarios.design.parts import Assembly, DesignPart, Parts, Tolerance, load_parts
from scenarios.design.predictor import Predictor, TranslucentPredictor
from scenarios.design.robust import Robustness, robustness
from scenarios.design.search import Found, search
from scenarios.design.study import Study, study
from scenarios.design.verified import Verified
from scenarios.design.verify import verify

__all__ = [
    "Assembly",
    "Candidate",
    "DesignPart",
    "Found",
    "Goal",
    "Parts",
    "Predictor",
    "Robustness",
    "Space",
    "Study",
    "Tolerance",
    "TranslucentPredictor",
    "Verified",
    "builtin_goals",
    "load_goal",
    "load_parts",
    "robustness",
    "search",
    "study",
    "verify",
]
