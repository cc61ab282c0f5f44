"""Command line of calibrations: fit, identify, check, show, plan."""

from jaxthermo.console import interrupt as _interrupt  # noqa: F401


# isort: split
import sys
from collections.abc import Sequence
from pathlib import Path

from jaxthermo.console.entry import Flag, Overrides, compiles, make_app, run_app


app = make_app(
    "calibrate",
    "Fit weights, materials and coefficients to reference runs or thermograms.",
)


@app.command
@compiles
def _fit(
    config: Path,
    /,
    *,
    out: Path | None = None,
    overrides: Overrides = (),
    devices: int = 1,
) -> None:
    """Fit the parameters of a config, and write a card and a report.

    The same command continues an interrupted fit from its last step.

    Args:
        config: Calibration, a YAML file.
        out: Folder for fit.json, card.yaml and report.html;
            results/calibration/NAME by default.
        overrides: Value to change, such as fit.seed=3; may be repeated.
        devices: Number of devices that share the derivatives of a step, or the starts
            of a search from several. More than can be shared are refused.
    """
    from .cli import fit as run

    run(
        config,
        out=out or Path("results/calibration") / config.stem,
        overrides=overrides,
        devices=devices,
    )


@app.command
@compiles
def _identify(config: Path, /, *, overrides: Overrides = ()) -> None:
    """Report how well the data determine each parameter, without a fit.

    Args:
        config: Calibration, a YAML file.
        overrides: Value to change, such as fit.seed=3; may be repeated.
    """
    from .cli import identify as run

    run(config, overrides)


@app.command
@compiles
def _check(card: str, /, *, scene: Path, overrides: Overrides = ()) -> None:
    """Check if a fit card is valid for a scene: its ranges, and the error there.

    Args:
        card: File card.yaml of a fit, or card://NAME of a shipped card.
        scene: Scene, a YAML file; its body gets the structure of the card.
        overrides: Value of the scene to change; may be repeated.
    """
    from .cli import check as run

    run(card, scene, overrides)


@app.command
def _show(folder: Path | None = None, /, *, shipped: Flag = False) -> None:
    """Print the results of a fit, or list the fit cards of the package.

    Args:
        folder: Folder written by `calibrate fit`.
        shipped: List the fit cards of the package, for `weights: card://NAME`.
    """
    from .show import show as run

    run(folder, shipped)


@app.command
@compiles
def _cards(
    folder: Path,
    /,
    *names: str,
    out: Path = Path("cards"),
    again: Flag = False,
    results: Path = Path("results/cards"),
) -> None:
    """Fit a card of every structure on every body.

    The same command continues with the cards that are missing or out of date.

    Args:
        folder: A folder with `bodies`, calibrations without parameters, and
            `structures`, the parameters, both as YAML files.
        names: Cards to make, such as buddha/octree; all by default.
        out: Folder for the cards, as BODY/STRUCTURE.yaml.
        again: Fit the cards that are up to date too.
        results: Folder for the results of the fits.
    """
    from .cli import cards as run

    run(folder, names=names, out=out, results=results, again=again)


@app.command
@compiles
def _plan(
    scene: Path,
    /,
    *,
    tolerance: str | None = None,
    kelvin: str | None = None,
    time_budget: str | None = None,
    memory: str | None = None,
    search_time: str | None = None,
    out: Path | None = None,
    again: Flag = False,
    run: Flag = False,
    overrides: Overrides = (),
) -> None:
    """Search for the fastest model of a scene whose error is within a tolerance.

    Writes scene.yaml, which `jaxthermo simulate` runs as it is, and plan.json. Exit
    status 3 if no model is within the tolerance. The same command continues an
    interrupted search.

    Args:
        scene: Scene, a YAML file; its pitches, structures and solver are replaced.
        tolerance: Largest error in percent of the range of the surface, such as 1%.
        kelvin: Largest error as a temperature difference, such as 0.2.
        time_budget: Longest run time of the compiled run, such as 10ms.
        memory: Largest peak memory, such as 2GB.
        search_time: Longest time of the search, such as 2m, after which the best model
            so far is taken; the first reference is always run.
        out: Folder for the results; results/plan/NAME by default.
        again: Search even if a plan of the same scene and tolerance is stored.
        run: Simulate the planned scene at once, into the folder OUT/run.
        overrides: Value of the scene to change; may be repeated.
    """
    from .plan.command import plan, search_time_of, tolerance_of

    limits = tolerance_of(tolerance, kelvin=kelvin, run_time=time_budget, memory=memory)
    folder = out or Path("results/plan") / scene.stem
    plan(
        scene,
        overrides=overrides,
        tolerance=limits,
        out=folder,
        search_time=search_time_of(search_time),
        again=again,
        run=run,
    )


@app.command
def _schema() -> None:
    """Print the JSON Schema of a calibration, with units, for editors."""
    from jaxthermo.config.json_schema import json_schema

    from .config.schema import CalibrationConfig

    sys.stdout.write(json_schema(CalibrationConfig))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command and exit: 0 if it worked, 2 for a mistake of the user."""
    run_app(app, "calibrate", arguments)


if __name__ == "__main__":
    main()
