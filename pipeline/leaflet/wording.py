"""What the page says in so many words."""

QUESTION = """\
A robot drives a route once, with a LiDAR, on one day. For how long can it find its way there from that day alone: as leaves
come and go, cars and fences move, buildings are built, and it drives the other side of the street or the other way round? And
when it leaves the streets that it knows, does it know that it does not know?

Two protocols judge every answer. **By distance** an answer is right if it lies near the query. **By cells**, the papers' way,
it is right if it names the very grid cell. Every table and figure says which.
"""
MAP = """\
Each point is one query, where it was taken. Choose one to see what the sensor saw there beside what was seen where the method
says that it is; the line leads from the query to the answer. Drag to move; zoom with the buttons, two fingers, or the wheel
once the map was clicked; the arrow keys go along the drive.
"""
DRIVEN = (
    "Logs {driven}. Trained on {train} alone, tested on {tests} other days; submaps: {submap}; budget: {budget}; {rows} training"
    " submaps in {places} cells."
)
BY = {
    "cells": "Seen if training was in the query's cell of {cell_m:g} m, right if the answer is that cell.",
    "distance": "Seen if a training pose is nearer than {seen_m:g} m, right if the answer lies within {correct_m:g} m.",
}
METHODS = "Methods, and how much of their own full training they were given"
COSTS = "What training cost where it was done on this machine, and a query: medians of one thread, from its points to its place"
SEQUENCES = "Test sequences by both protocols"
MAIN = {
    "recall_at_1": "How often the first answer is right, rejection ignored, by {protocol}, with 95 % intervals",
    "auc_top1": "Area under precision over recall, by {protocol}, with 95 % intervals",
}
MEANS = "All other numbers: means over the test sequences, by both protocols"
HEADINGS = "Headings, of queries placed right, with 95 % intervals"
COMPARED = "Differences to `{reference}` on the same queries, by {protocol}"
