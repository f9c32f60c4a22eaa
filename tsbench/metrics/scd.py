"""SCD, the primary metric: sign-compliant and arrived.

Of an episode it is yes or no (`is_scd`): `Verdicts.against` of `tsbench.rules.monitor` collects what counts
against it, events of the targets' rules, needless obedience in a contrast half, and the wrong way. An episode with an
error outcome has it not.

A figure of SCD is a share of one part of the records (`Records.of`): of the signed halves (and what has no pair), of
the contrast halves, or of the pairs. A pair passed where both halves did: paired SCD, the primary figure. Over several
types it is the mean of the types' shares (`tsbench.metrics.breakdown`).
"""

from __future__ import annotations

from tsbench.episode.outcome import EpisodeFacts, Outcome
from tsbench.metrics.metric import Metric
from tsbench.scenarios.spec import CONTRAST, SIGNED


def is_scd(facts: EpisodeFacts) -> bool:
    """SCD of an episode: arrived, the targets' rules kept, nothing obeyed needlessly, and never the wrong way."""
    return facts.outcome is Outcome.ARRIVED and not facts.verdicts.against


SCD = Metric(
    "scd",
    bool,
    lambda e: is_scd(e.facts),
    "compliant and arrived, never the wrong way, and in a contrast scene nothing obeyed needlessly: the primary "
    "metric; false for an error outcome",
    unit="%",
    scale=100.0,
    failure=0.0,
    about_rule=True,
)
# Figures of SCD by their names in summaries, the primary one first: share of squares (scenarios with two signs) with
# all four rows passed, of pairs with both halves passed, of signed halves (and what has no pair), of contrast halves.
SQUARED, PAIRED, SIGNED_ONES, CONTRASTED = PARTS = "squared_scd", "paired_scd", "signed_scd", "contrast_scd"
# The half whose episodes a figure is over, where it is not both.
HALF_OF = {SIGNED_ONES: SIGNED, CONTRASTED: CONTRAST}
# The figures of SCD as tables call them.
NAMES = {SQUARED: "squared SCD", PAIRED: "paired SCD", SIGNED_ONES: "signed SCD", CONTRASTED: "contrast SCD"}
SCD_NOTE = (
    "SCD: sign-compliant and arrived, %, macro mean over types. Paired: both halves passed; signed, "
    "contrast: each half by itself, by the pair's type; signed SCD also counts scenes without a pair"
)
