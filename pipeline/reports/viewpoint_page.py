"""viewpoints.md: paper 2's protocol in words, its numbers for each sequence, and what a reader must know of them."""

from collections.abc import Mapping, Sequence

from pipeline.reports.illustration import Illustration
from pipeline.reports.learned import Learned
from pipeline.reports.viewpoint_tables import TITLES, Seeds, after_learning, every_heading, over_headings, over_seeds
from pipeline.reports.wording import SIMULATED

PROTOCOL = """\
Every test sequence is matched **with itself**: its views, drawn every {step_deg:g}° from the robot's own heading on, are the
reference, and each place is asked about again from every heading half way between: {first_deg:g}°, {second_deg:g}° and so on.
So this is about viewpoints alone; how a method does in another season is told by the study of the year, not here.

- A query's match is **correct** within {correct_m:g} m of where the query was taken. The query's own row is in the reference; its
  image is drawn at another heading, and around a position that is off by as much as the view's `jitter_m` says.
- Queries count from the first that has a whole window of {length} steps around it to the last.
- **ROC-AUC** is paper 2's index: the chance that a correct match scores above a wrong one; .5 is guessing. Where all matches of
  a heading are correct, or none is, there is no ROC-AUC: that heading is left out of the mean, and the table says how many
  are in.
- **PR-AUC** is the area under precision over recall as paper 2 draws them, where **recall is of the method's own correct
  matches**, not of all queries: a method that is right at one query in ten, and knows which, has a perfect curve. Read it beside
  the accuracy.
- **accuracy** is the share of all queries whose match is correct.
- **recall** is of all queries: the share that is matched correctly *and* accepted, at the threshold that accepts most of them
  at a precision of 99 % or more. Accepting everything, it would be the accuracy.
- **bytes a place** is by how much the model grows with a place of the reference: its codes or image, and where it lies.

**Not to be compared with the published bars.** The plotting code that was published with paper 2 changes some of the areas by
constants before it draws the bars of Fig. 6, and which version of it drew the published figure is not known. Its precision-recall
curves are drawn from unchanged data.
"""
LEARNED = """\
At the round that was kept, else the last: the variance of the codes and their mean distance say whether they collapsed, the error
is of held-out images from −1 to 1. ± is over seeds.
"""
IN_BRIEF = """\
Mean over the headings ± standard deviation over them. ROC-AUC and PR-AUC say how well a method knows which of its matches are
correct, accuracy how many are.
"""
HOW_TO_READ = {
    "mapping": "From left to right, all from above with the front up: the newest scan; the octree's occupied leaves in the band"
    " of heights that is drawn, and the nodes two levels above; the image that the methods get.",
    "curves": "One panel a heading. Recall is of each method's own correct matches, so a curve ends at 1 whatever the method: the"
    " number in the panel, its accuracy, says how many matches that is. A method without a correct match has no curve.",
    "indices": "Points are means over the sequences and seeds, each of them a faint dot. The dashed line is guessing.",
    "reconstructions": "One place, seen by a robot that is turned counter-clockwise by so much. Under each reconstruction stands"
    " its mean squared error against what was seen, of pixels from −1 to 1: the networks' own scale.",
    "collapse": "A line a seed. Codes that draw together while learning have collapsed: to such a method all places look alike,"
    " and its reconstructions all look the same.",
}


def page(
    name: str, simulated: bool, judged: Seeds, learned: Mapping[str, Sequence[Learned]], plates: Sequence[Illustration]
) -> str:
    """The whole of viewpoints.md."""
    first = next(iter(judged.values()))[0]
    step_deg = 360 / len(first.headings_deg)
    words = {"step_deg": step_deg, "first_deg": step_deg / 2, "second_deg": 1.5 * step_deg, **vars(first)}
    seeds = over_seeds(judged)
    final = after_learning(learned)
    blocks = [
        f"# Viewpoints in {name}\n",
        *([SIMULATED] if simulated else []),
        "## What is asked\n",
        PROTOCOL.format(**words),
        "## Results\n",
        "Mean over the headings ± standard deviation over them" + (", of the mean over seeds" if seeds else "") + ".\n",
        over_headings(judged).markdown(),
        *(["Mean over the headings, then over the seeds ± standard deviation over those.\n", seeds.markdown()] if seeds else []),
        *(["## What was learned\n", LEARNED, final.markdown()] if final else []),
        "## Figures\n",
        *_figures(plates),
        "## Every heading\n",
        *(text for key, title in TITLES.items() for text in (f"### {title}\n", every_heading(judged, key).markdown())),
    ]
    return "\n".join(blocks)


def text(name: str, simulated: bool, judged: Seeds) -> str:
    """viewpoints.txt, for a terminal."""
    heading = (
        f"{'simulated ' if simulated else ''}{name}: each sequence matched with itself, from headings between the reference's"
    )
    tables = [table.text() for table in (over_headings(judged), over_seeds(judged)) if table]
    return "\n".join([heading, "", *tables, IN_BRIEF])


def _figures(plates: Sequence[Illustration]) -> list[str]:
    """Those of one kind after each other, with how to read them said once."""
    told = []
    for i, one in enumerate(plates):
        told.append(f"### {one.title}\n\n![{one.title}]({one.path})\n")
        told += [] if i and plates[i - 1].kind == one.kind else [f"{HOW_TO_READ[one.kind]}\n"]
    return told
