"""What report.md and results.txt say in so many words: the caveats, the protocols, how to read a figure, what the words mean."""

SIMULATED = (
    "**Simulated, not recorded data.** Every number below was measured in a world that this project made up and swept\n"
    "with a simulated sensor: it shows how the methods compare, not how they would do on a real site.\n"
)
HOW_TO_READ = {
    "precision_recall": "One panel a test sequence: the further a curve stays at the top on its way right, the better; the dot is"
    " the threshold that the model chose without seeing any test sequence.",
    "recall_at": "How often a right place is among the first n, rejection ignored: the mean over the test sequences, each of them"
    " faint. Where the curve still climbs, a second look at the first few places would help.",
    "year": "Each point is one test sequence, at its distance in days from training: a method that lasts stays level. Bands are"
    " 95 % intervals; the grey line is the oracle's recall@1, a share of the seen queries and no AUC.",
    "novelty": "The seen are stacked, right below misplaced; the dark outline is the unseen; each has area 1. The less they"
    " overlap left and right of the dashed threshold, the better the method knows what it does not know.",
    "rejection": "Thresholds were chosen on held-out parts of the training day for the dashed precision. A marker below the line"
    " broke that promise, one high above it gave recall away; a marker that is missing accepted nothing. Bars are 95 % intervals,"
    " long where little was accepted; a very long one is cut.",
    "reliability": "On the diagonal, a confidence of 80 % is right 8 times of 10; red lines show how far off a bin is, and their"
    " mean length over the queries is the expected calibration error (ECE). Below: how many queries were answered so surely.",
    "matches": "Each row is one query; heights are coloured from blue (0 m) to red (15 m), near rings at the bottom. Right ones"
    " are picked over the year; wrong ones (red) are those that looked least new, at most one a stretch of path: *next cell* is"
    " wrong by cells alone, *misplaced* and *unseen* by distance. Training images are rolled to where they look most like the"
    " query. A method that looks at something else is shown by the Scan Contexts of the same places.",
    "map": "By cells. Each point is one query where it was taken: light blue was placed right, dark blue rightly turned away as"
    " unseen, orange turned away although seen, red placed wrong or placed although unseen.",
    "montage": "By cells, of several methods a row each. All maps on one scale: look for errors that stay at one spot through the"
    " year, and for streets off the grey. Red along the training path is often the neighbouring cell: right by distance.",
    "history": "The weights kept are those of the dashed round, the best on held-out blocks of training; a held-out loss that"
    " turns up while the training loss goes on down is over-fitting.",
}
JUDGED_BY = """\
Every number is by one of two protocols, and says which.

- **By cells**, the papers': a query is *seen* if training has a submap in its grid cell of {cell_m:g} m, else *unseen*; an
  answer is right if it is that cell. Recall is hits / (hits + misses): a misplaced query is a false alarm and not held against
  recall, which so reaches 1 once everything is accepted. Cells have borders: an answer 3 m off can be wrong, and an unseen cell
  that touches the training path cannot be told from it by any method.
- **By distance**: *seen* if a training pose is nearer than {seen_m:g} m, *unseen* if none is within {unseen_m:g} m, and not
  judged between; an answer is right within {correct_m:g} m. Recall is the usual one, hits / all seen: a misplaced query counts
  against it.
- The **oracle** answers the place of the nearest training pose, and rejects by the distance to it: by cells the mark to reach,
  by distance 1 by construction.
"""
DEFINITIONS = """\
- **budget** is the share of a method's own full training that it was given, with the parameters listed under Set-up: a small
  budget may also train on less of each view. A **round** is what it learns between two looks at the held-out blocks of training:
  an epoch, or some hundred steps. A method that had little of its training may be much better than it looks here.
- **recall@n** is the share of the seen queries with a right answer among the first n, rejection ignored. A classifier's n answers
  are n places; a descriptor method's are training submaps, of which several may lie in one place unless
  `distinct_places` is true.
- A query is **rejected** as unseen if its novelty reaches a threshold. Accepted with a right answer it is a **hit**; accepted
  otherwise, be it unseen or seen but misplaced, a **false alarm**; rejected though seen, a **miss**. Precision is
  hits / (hits + false alarms).
- **AUC** is the area under precision over recall by trapezoids through 200 thresholds, as the SCI authors' code draws it; the
  **exact** one goes through every novelty that was met. **F1max** is the best harmonic mean of the two along that curve,
  **R@99%P** the largest recall at a precision of 99 % or more. By cells all of these leave misplaced queries out of recall.
- **AUROC** is the chance that an unseen query looks newer than a seen one: .5 is guessing.
- **precision** and **recall** in the tables are at the threshold that each model chose on held-out parts of training; a dash and
  0 mean that no threshold kept the wanted precision there, so that the model rejects everything.
- **error** is the median distance from a seen query to the first answer, rejection ignored: to the middle of the answered place,
  or to the matched training submap where a method matches such.
- **heading error** is the median angle between the told heading and the true one, and **within 10°** the share that is no further
  off, of the seen queries that are placed right: an answer in another street has no heading to compare.
- Intervals in brackets hold 95 % of {resamples:,} resamples of the query path in blocks of {block_m:g} m, since neighbours fail
  together. A path of few blocks makes them a little too narrow, and they know of chance along the path only, not of another seed
  or another world.
"""
PAIRED = """\
Each method is held against `{reference}` on the same queries: Δ is its number minus `{reference}`'s. Intervals and p are of
the differences in {resamples:,} resamples of blocks of the path, the same for both methods; p is two-sided, at least
2 / {one_more:,}, and corrected over the sequences after Holm, which holds the chance of a single false claim. *better* and
*worse* are claimed below p = {level:g}; a path of few blocks makes p a little too small, and another seed or world is not in it.
The last columns count seen queries whose first answer is right by one of the two alone.
"""
MARKED = """\
Behind a number, + and − say that the method is better or worse than `{reference}` there, by the paired test further down (of AUC:
of the exact one).
"""
KINDS = """\
Means over the test sequences, of precision over those where anything was accepted. Thresholds were chosen on held-out parts of
training, by cells.
"""
HEADINGS = """\
Of the seen queries that are placed right, how far the told heading lies from the true one.
"""
WORDS = (
    "budget: share of a method's own full training. In brackets: 95 % intervals. oracle: the nearest training pose's place,"
    " rejected by the distance to it. AUC: area under precision over recall; precision and recall: at the model's own threshold;"
    " R@99%P: recall at 99 % precision; AUROC: unseen told from seen; error: median of the seen."
)
TOLD_HEADINGS = " heading error: median of the seen that are placed right."
SURELY = (
    " + and −: better and worse than {reference} on the same queries (paired test, p < {level:g} after Holm;"
    " of AUC the exact one)."
)
