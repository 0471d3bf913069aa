"""Pictures of `features`: a contact sheet of fish, Figs. 5 and 7, tracks, orientations."""

from stages.run import run  # isort: skip  (before numpy)

from pathlib import Path

from finloop.io.picture import save_figure, save_picture
from finloop.plots import features as draw
from finloop.plots.parts import message
from finloop.plots.turn import figure5, strongest_turn
from finloop.project import Project

REPORT = Path("reports/features")
COLUMNS = ("backbone_x_px", "backbone_y_px")
FISH = 48  # on the contact sheet


def main() -> None:
    """Draw the pictures in reports/features/.

    They are contact_sheet.png, fig5.png, fig7.png, trajectories.png and rose.png.
    """
    with Project() as project:
        table, background = project.features, project.background
        tracks, rows = project.tracks(COLUMNS), draw.choose_doubtful(table, FISH)
        fish = draw.specimens(table, tracks, rows, project.cutouts, background)
        save_picture(REPORT / "contact_sheet.png", draw.draw_specimens(fish))
        fig5 = message(
            "Fig. 5: this film has no clear turn, one that begins with straight swimming."
        )
        if (turn := strongest_turn(table)) is not None:
            turning = draw.specimens(table, tracks, turn, project.cutouts, background)
            fig5 = figure5(table, turn, list(turning), background)
        for name, figure in (
            ("fig5", fig5),
            ("fig7", draw.figure7(table)),
            ("trajectories", draw.draw_trajectories(table, background)),
            ("rose", draw.draw_rose(table)),
        ):
            save_figure(REPORT / f"{name}.png", figure)


if __name__ == "__main__":
    run(main)
