"""Texts of the page that say why each statement of the 2008 paper holds on a plant or not."""

SLIDERS = (
    "Needs friction at the sliders. With Table 1 the sliders rub with a few millinewtons, and "
    "constant weights keep "
    "the tensions constant: nothing stretches the tendons."
)
"""Reason that three statements share."""

REASONS = {
    "C1": SLIDERS,
    "C2": "It is the other way round: friction μT stretches the opposing tendon by Uμ/((1−μ)k) "
    "and shortens the "
    "assisting one by Uμ/((1+μ)k), so the assisting tendon is the better one.",
    "C3": SLIDERS,
    "C4": SLIDERS,
    "C5": "At low tension Table 1 is nearly right, so a filter that trusts it is close.",
    "C6": "The tendons stretch in proportion to the tension. It holds where the estimate is read "
    "as x/r; taken from "
    "the geometry, the angle of the loaded tendon saturates at 90°, and its error can hardly grow.",
    "C7": "The model removes the stretch, whatever it takes the friction for.",
    "C8": "Needs friction at the axle that grows faster than the load: the simulation with Table "
    "1 then turns too "
    "far, the more so the higher the tension.",
    "C9": "A matter of the sensor alone, not of friction.",
    "C10": "On the plant with more friction the noise of the load cells costs more than what they "
    "tell beyond the hung "
    "weights. On the plant with the friction of Table 1, where little rubs, the weights swing, "
    "and only the load cells see that.",
    "C11": "The filter takes the readings of the load cells as what pulls, so their noise moves "
    "the modelled link.",
    "C12": "At 2 N / 6 N, where it is measured, Table 1 is nearly right already, and the filter "
    "of 2008, whose Q "
    "and R are not those of its sensors, errs more with the exact friction. At higher tension a "
    "better friction "
    "model takes most of its error away: see the table of errors.",
}
"""Key of a statement → why it holds, or does not."""

SEARCH_NOTE = (
    "How the plant with more friction was found: plants were drawn over the friction of the "
    "sliders (constant and by "
    "load), "
    "exponent, reference load and preload of the axle's friction, and the angle of Series 1, and "
    "each was read both "
    "ways, as x/r and from the geometry. The plant on which most of the twelve statements hold is "
    "that one, "
    "so all twelve have chosen it. python -m benchmarks.rig_search does this again: it draws the "
    "map, tests each "
    "statement on the plant that the other eleven choose, and names the pairs that exclude each "
    "other. What it "
    "found stands in docs/results/reproduction.md."
)
"""Text on how the plant with more friction was found."""

EKF_NOTE = (
    "Bold is the smallest error of a row. ekf is the filter of 2008 with the noise of the sensors "
    "as the simulation "
    "has it. On the plant with the friction of Table 1 it is given the exact model and the exact "
    "noise, "
    "and then nothing can be "
    "better. At 2 N / 6 N Table 1 is nearly right on the other plant too, and both filters that "
    "take it for "
    "exact beat adaptive, which keeps room for friction that is wrong. From 3 N / 9 N on Table 1 "
    "is wrong, and that "
    "room is what keeps adaptive right."
)
"""Text below the table of errors."""
