"""Published cases by their ids."""

from experiments.verification.verify import GROUPS


CASES = {case.id: case for group in GROUPS for case in group.cases}
