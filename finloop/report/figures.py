"""The pictures of the page: the path of each, and the figure of the paper that it shows.

A picture whose file does not exist (a film without loops or without a gait) is left out.
"""

from typing import NamedTuple

FISH, CURVE = "fish paper", "curve paper"


class Figure(NamedTuple):
    """One picture of the report: its path below reports/, and its texts.

    number: of the paper's figure or table, "" for a picture that is not in the paper. alt: what a
    reader hears who does not see the picture.
    """

    path: str
    number: str
    title: str
    caption: str
    alt: str

    @property
    def id(self) -> str:
        """Return the picture's name as an anchor in the page."""
        return self.path.removesuffix(".png").replace("/", "-").replace("_", "-")


class Chapter(NamedTuple):
    """A part of the report: its heading, a text and pictures.

    id: anchor in the page. paper: FISH or CURVE, the paper to whose figures `Figure.number` refers.
    text: the paragraph below the heading.
    """

    id: str
    title: str
    paper: str
    text: str
    figures: tuple[Figure, ...]


SWIM = Chapter(
    "swimming", "Where it swims, and how", FISH,
    "The fish swims from goal to goal in every mode: the paper's network, loops and hybrid, and "
    "finloop's own, matching. Orange is film as filmed, yellow film bent into another pose, pink "
    "the mirror image of film, blue a sprite, green a predicted pose.", (
        Figure("modes/render/network.png", "Fig. 16", "Network: the path through the goals",
               "The trained network moves sprites (Fig. 18); the colour is the state. Goals are "
               "numbered in order, with the time at which the fish reached each.",
               "The tank from above with the path of the fish from its start through each goal."),
        Figure("modes/render/loops.png", "§4.2", "Loops alone",
               "The position table chooses video loops. Loops alone do not lead to every goal: at "
               "a cross no loop stays in the tank, and the fish swims on the spot.",
               "The tank from above with the path of a fish that plays video loops alone."),
        Figure("modes/render/hybrid.png", "Fig. 17", "Hybrid: loops, and the network between",
               "Orange: video loops. Blue: the network's sprites. Diamonds: gateways between them "
               "(A and B in the paper's figure).",
               "The tank from above with the path of the fish in two colours."),
        Figure("modes/render/matching.png", "", "Matching",
               "finloop's own mode, not in the paper: one search over all frames, their mirror "
               "images and predicted poses.",
               "The tank from above with the path of the fish in the colours of what is shown."),
        Figure("modes/render/switches.png", "Fig. 19", "Switch by switch",
               "The rendered mode, one switch per row: three ticks before it and five from it on. "
               "The colour of the bar is the source of the picture; per cent is the weight of the "
               "picture that fades out.",
               "Rows of eight successive pictures of the fish around each switch."),
        Figure("modes/animate/kinematics.png", "", "Speed and turning, against the film",
               "Speed and turn rate of the fish in all modes and in the film (grey). Outlines "
               "near the grey are good.",
               "Histograms of speed and turn rate of film and animations; bars of the time spent "
               "in each state."),
        Figure("modes/animate/path/path.png", "", "The requested path and the path of the fish",
               "At rings, and stripes on the right, the fish has left the path; "
               "data/animate/beside/left.csv has each cause.",
               "The tank from above with the requested path and the path of mode matching; curves "
               "of the error along them."),
        Figure("modes/retarget/backbones.png", "", "Motion of another animal",
               "The film's fish swims a recorded track: the requested line in blue, the drawn "
               "backbone in red. The last picture has the largest error.",
               "Twelve pictures of the fish with two lines along its body."),
        Figure("modes/realism/auc.png", "", "Told by its motion",
               "A classifier distinguishes seconds of animation from seconds of film by how the "
               "fish moves. An area of 0.5: it cannot. For comparison: one half of the film "
               "against the other, and the film drawn again. On the right, the area of each "
               "channel alone; whiskers are 95 % intervals.",
               "ROC curves of all modes and of the film's halves; bars of the areas for all "
               "channels and for each alone."),
        Figure("modes/realism/picture_auc.png", "", "Told by its picture",
               "The same by crops of the pictures, the film's with its own light and grain. Crop "
               "and crop change, on the right: a small network looks at single crops and at their "
               "changes from tick to tick.",
               "ROC curves of all modes and of the film's halves; bars of the areas for all "
               "channels of the pictures, for each alone, and for a network."),
        Figure("modes/realism/looks.png", "", "Where the network looks",
               "Bright: pixels that count most in the most obvious crops of each mode. Under the "
               "map lies one of these crops. A pixel that equals the still tank counts nothing.",
               "Maps of the crop around the fish, two for each mode and for the film's halves."),
        Figure("modes/realism/pictures.png", "", "The pictures that are most obviously false",
               "Each mode's seconds with the highest scores, each above the second of film most "
               "like it, as crops headed right.",
               "Rows of successive crops of the fish, animation above and film below."),
        Figure("modes/realism/contact_sheet.png", "", "The most obviously false motion",
               "Each mode's seconds with the highest scores, each above the most similar second of "
               "film. On the right, the channels of both.",
               "Rows of successive pictures of the fish, animation above and film below, with "
               "four small charts each."),
        Figure("modes/render/contact_sheet.png", "", "The liveliest stretch, tick by tick",
               "Forty successive pictures, in reading order.",
               "Forty successive pictures of the fish as it turns."),
        Figure("tank/contact_sheet.png", "", "The tank in three dimensions",
               "One camera per row.",
               "The fish in a glass tank, seen by several cameras at several moments."),
    ),
)  # fmt: skip
FILM = Chapter(
    "filmed", "The content of the film", FISH,
    "finloop cuts out, follows and measures the fish; a network learns how they move.", (
        Figure("film/extract/fig3_4.png", "Figs. 3, 4", "Side branches, and what is kept",
               "Every pixel above the noise, thinned: the fish with the most side branches, and "
               "the fish for which two rules differ most, if any. The paper numbers the pixels "
               "from A and keeps the branch with the greatest number, D (orange). finloop weights "
               "each step by the width of the fish (blue). It thins the silhouette alone (green), "
               "without pale pixels; the title counts the remaining branches.",
               "One or two fish in four pictures each: film, thinned line with its branches, "
               "numbers at their joints and ends, and the kept lines over the film."),
        Figure("film/features/fig5.png", "Fig. 5", "A turn in successive frames",
               "The film's strongest clear turn at t0, t0 + k and t0 + 2k; k is Δ, or a multiple "
               "of it for a fish that turns slowly. Above, the cut-out over the empty tank. Below, "
               "backbone, control points, the closed B-spline with the motion area (relative to "
               "the largest), and the heading, beside that of k before. The curves show all "
               "frames.",
               "Three pictures of a fish that bends and turns, the same with lines drawn over "
               "them, and curves of motion area and heading."),
        Figure("film/features/fig7.png", "Fig. 7", "Motion area and swimming type",
               "The longest track: how strongly the body is bent, relative to the largest value, "
               "and the swimming type.",
               "A curve of motion area with peaks at every turn; below, steps between left, "
               "straight and right."),
        Figure("film/features/rose.png", "Table 1", "Headings",
               "Share of the film in each orientation, by swimming type; 1 is to the right, "
               "counted anticlockwise.",
               "A rose with a bar for each orientation, divided into straight, left and right."),
        Figure("film/features/trajectories.png", "", "Tracks",
               "The path of every fish that finloop followed.",
               "Coloured tracks over the background of the tank."),
        Figure("film/identity/timeline.png", "", "The tracks of each animal",
               "Each row is an animal, each bar a track; a dot is a join through a touch, its "
               "colour the probability. Motion and appearance identify the animals.",
               "A chart of bars over time, a row for each animal, with dots between the bars."),
        Figure("film/calibrate/distributions.png", "", "The school",
               "Distance, alignment and bearing of the nearest neighbour, distance from the wall, "
               "and polarisation of the school. Points swim by zones fitted to the first half of "
               "the film (Couzin et al. 2002), and without other fish.",
               "Five charts of distributions: both halves of the film, and points that swim."),
        Figure("film/pose/shapes.png", "", "Postures",
               "The principal shapes of the poses, from two standard deviations to one side to "
               "two to the other. After a jump the animal continues to bend in them.",
               "Rows of one animal, bent more and more to one side and to the other."),
        Figure("motion/bpn/fig15.png", "Fig. 15", "Learning",
               "Error per epoch, on training rows and on held-out rows.",
               "Two charts of error that falls quickly and then stays level."),
        Figure("motion/bpn/held_out.png", "", "Predicted and true",
               "Held-out rows: motion area Δ later, and swimming type as a table of confusions.",
               "A scatter of predicted against true motion area, and a three by three table."),
        Figure("motion/forecast/learning.png", "", "Learning to predict the next pose",
               "Error per epoch, and how often the truth lies within the predicted spread.",
               "A chart of error that falls and then stays level; a chart of shares near a line."),
        Figure("motion/forecast/free.png", "", "Swimming by prediction",
               "A fish that swims freely by the forecast, beside the fish of the film.",
               "Distributions of speeds, turn rates and poses, and how long they last."),
        Figure("motion/distance/fig9.png", "Fig. 9", "Distances of frames",
               "Dark frames are alike. Left every pair (Eq. 5), right only like with like (Eq. 6): "
               "tinted pairs are never computed.",
               "Two square maps of distances between frames."),
        Figure("motion/sprites/contact_sheet.png", "", "The frames of the sprites",
               "Chosen automatically: a tail beat, a glide and the strongest turns, each before "
               "and after rotation.",
               "Rows of pictures of the fish: swimming straight, gliding, turning left and right."),
        Figure("motion/gateways/contact_sheet.png", "Fig. 14", "Gateways",
               "From sprites into the film and back: the best and worst gateways.",
               "Rows of pictures: the last one shown, its natural successor, and the one shown."),
        Figure("motion/loops/fig10.png", "Fig. 10", "Three routes from G to F",
               "Four loops of one track that lie much as in the paper. Case 1 plays on to H and "
               "jumps, case 2 jumps at once, case 3 takes one more loop on the route; the letters "
               "between are this film's. A jump's distance is in natural steps, the usual change "
               "from frame to frame.",
               "Four arcs over a time line with ends A to H, the fish at these ends, and three "
               "routes as solid lines joined by dotted ones."),
        Figure("motion/loops/fig11.png", "Fig. 11", "Position table",
               "The quadrant of a later loop end, seen from an earlier one: 1 upper right, 2 upper "
               "left, 3 lower left, 4 lower right.",
               "Loop ends along one track, and a triangular table of quadrants."),
        Figure("motion/loops/over_time.png", "Fig. 12", "Groups of loops",
               "Loops of different groups never overlap in time. Above, loops within one track, as "
               "in the paper: one bar per group, with its number of loops, and some loops as arcs. "
               "Then a row for each group of all loops, also those from track to track. Last, the "
               "film that can be played for ever, and the longest dead ends by name.",
               "Arcs and bars over a time line, rows of bars, and a coloured bar with names."),
        Figure("motion/loops/fig13.png", "Fig. 13", "An improper loop",
               "Two frames are alike, but between them the fish travels against its mean heading, "
               "or against its heading at one of them. In a loop it would drift backwards, so the "
               "pair is left out.",
               "The path of a fish over the tank with arrows of its heading and of the loop's "
               "travel; below, the fish at both ends."),
        Figure("motion/loops/over_tank.png", "", "Loops in the tank",
               "Loop ends at their filmed places.",
               "Dots and arrows over the background of the tank."),
        Figure("motion/loops/best_and_worst.png", "Fig. 8", "The best and the worst loops",
               "The frame on screen, the next frame of the film, and the loop's frame instead.",
               "Rows of pictures of the fish that differ little."),
    ),
)  # fmt: skip
CURVES = Chapter(
    "curves", "Curves", CURVE,
    "Outlines as wavelet coefficients: coarse, swinging, morphed.", (
        Figure("morph/figures/fig2.png", "Fig. 2", "One outline at every scale",
               "A digit's outline, kept with fewer and fewer coefficients, by the paper's two "
               "wavelets and the chosen one.",
               "The digit 3, ever coarser from left to right, in rows."),
        Figure("morph/figures/fig3.png", "Fig. 3", "The stiffness matrix",
               "In the wavelet basis, at two scales; black is large.",
               "A square matrix with bands along the diagonals of its blocks."),
        Figure("morph/figures/fig4.png", "Fig. 4", "Morphs",
               "Linear, at 8, 16, 32 and all control points; physical; and fold-free.",
               "A drawn face turns into another one, in six rows."),
        Figure("morph/figures/fig5.png", "Fig. 5", "Linear against physical",
               "Several elasticities, dampings and masses.",
               "The same morph of a face in five rows."),
        Figure("morph/figures/fig6.png", "Fig. 6", "A released hoop",
               "Bent, and back to rest, in grey. Without friction it would swing for ever.",
               "Successive outlines of a hoop that swings, and a plot of what is left over time."),
        Figure("morph/figures/fig7.png", "Fig. 7", "The hoop with few control points",
               "Solved at 4, 8, 16 and 32 control points; grey: at 256.",
               "Four rows of outlines of the hoop, from coarse to fine."),
    ),
)  # fmt: skip
_GAIT = (
    ("fig8", "Fig. 8", "The film of a cycle", "Pictures, or contours, of one cycle."),
    ("fig9", "Fig. 9", "The cycle", "Key poses 1 and 2, and those half a cycle later by symmetry."),
    ("fig10", "Fig. 10", "Subcycle A", "Key 1 dashed, key 2 solid, frames between dotted."),
    ("fig11", "Fig. 11", "The clock", "Progress within a subcycle against time: measured, and "
     "fitted by γ."),
    *((f"fig11_{sharing}", "Fig. 11", f"γ per {sharing}", "γ over the number of the coefficient; "
       "o is subcycle A, x subcycle B. In the grey band the motion never turns back.")
      for sharing in ("scale", "coefficient", "coordinate")),
    ("fig12", "Fig. 12", "The synthesised cycle", "From key poses and γ."),
    ("fig13", "Fig. 13", "Subcycle A in detail", "More of its frames, synthesised."),
    ("fig14", "Fig. 14", "With few control points", "The cycle solved at 4, 16 and 64 of them, and "
     "how far off."),
)  # fmt: skip
GAITS = Chapter(
    "gait", "Gait", CURVE,
    "A cycle of motion, described by a few numbers γ from a film, drives another drawing.", tuple(
        Figure(
            f"gait/figures/{folder}/{name}.png", number, f"{title}: {source}", caption,
            f"{title}, of {source}. {caption}",
        )
        for folder, source in (("limbs", "limbs"), ("outline", "the film's own fish"))
        for name, number, title, caption in _GAIT
    ),
)  # fmt: skip
CHECKS = Chapter(
    "checks", "Checks by eye", FISH,
    "If something looks wrong above, these pictures most often show the cause.", (
        Figure("film/clip/check.png", "", "The film",
               "A frame, its difference from the still tank, and over time the light, the camera's "
               "position, and the difference from frame to frame.",
               "A frame of the film, the animals dark on white, and three curves over time."),
        Figure("film/extract/detections.png", "", "Detected fish",
               "Colours distinguish fish from rejected silhouettes, by reason.",
               "Frames of the film with the outlines of silhouettes in several colours."),
        Figure("film/features/contact_sheet.png", "", "The most doubtful fish",
               "Backbone, control points, motion area and head of each.",
               "Pictures of single fish with a line along the body and an arrow at the head."),
    ),
)  # fmt: skip
CHAPTERS = (SWIM, FILM, CURVES, GAITS, CHECKS)
