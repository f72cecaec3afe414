"""Which variant the others are compared with."""

from pydantic import Field

from silmesh.settings.section import Name, Positive, Section


class ComparisonSettings(Section):
    """Comparison of the variants."""

    baseline: Name | None = Field(
        None, description="the variant that the others are compared with; the first if not given"
    )
    goal: Positive | None = Field(
        None,
        description="the loss to which steps and seconds are counted; the baseline's final one of "
        "each object, within 1 %, if not given",
    )
