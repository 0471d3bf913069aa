"""Pictures of `features`: a contact sheet of fish, Figs. 5 and 7, tracks, orientations."""

from pathlib import Path

from finloop.io.picture import save_figure, save_picture
from finloop.plots import features as draw
from finloop.plots.parts import draw_message
from finloop.plots.turn import figure5, find_strongest_turn
from finloop.project import Project

REPORT = Path("reports/film/features")
COLUMNS = ("backbone_x_px", "backbone_y_px")
FISH = 48  # on the contact sheet


def main() -> None:
    """Draw what `features` measured, in reports/film/features/.

    The files are contact_sheet.png (fish with their backbones), fig5.png (a turn), fig7.png (motion
    area over time), trajectories.png and rose.png (orientations).
    """
    with Project() as project:
        table, background = project.features, project.background
        tracks, rows = project.tracks(COLUMNS), draw.choose_rows_to_check(table, FISH)
        fish = draw.read_specimens(table, tracks, rows, project.cutouts, background)
        save_picture(REPORT / "contact_sheet.png", draw.draw_specimens(fish))
        fig5 = draw_message(
            "Fig. 5: this film has no clear turn, one that begins with straight swimming."
        )
        if (turn := find_strongest_turn(table)) is not None:
            turning = draw.read_specimens(table, tracks, turn, project.cutouts, background)
            fig5 = figure5(table, turn, list(turning), background)
        save_figure(REPORT / "fig5.png", fig5)
        save_figure(REPORT / "fig7.png", draw.figure7(table))
        save_figure(REPORT / "trajectories.png", draw.draw_trajectories(table, background))
        save_figure(REPORT / "rose.png", draw.draw_rose(table))
