"""What is done with outliers: views whose silhouette the other views contradict."""

from typing import Literal

from pydantic import Field

from silmesh.settings.section import Section, whole

Policy = Literal["auto", "keep", "drop", "repair"]
# What policy `auto` is, where it is not `repair`: what a person gave is left as it is, and a plain
# background that a threshold does not find is rare enough to do without the view.
POLICIES = {"mask": "keep", "alpha": "keep", "threshold": "drop"}


class Quality(Section):
    """What is done with outliers: views whose silhouette the other views contradict."""

    policy: Policy = Field(
        "auto",
        description="keep fits them as they are; drop leaves them out; repair segments them again "
        "with what the other views say, and leaves out what stays an outlier; auto is keep for "
        "mask and alpha, drop for threshold, repair for the others",
    )
    fewest: whole(2, 10_000) = Field(
        3, description="a run in which fewer views would be left fails"
    )

    def policy_for(self, source: str) -> str:
        """``keep``, ``drop`` or ``repair``, for silhouettes from this source."""
        return POLICIES.get(source, "repair") if self.policy == "auto" else self.policy
