"""The `yearloc` command: what it writes and prints, and that a mistake is answered by one line."""

import fcntl
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest
import yaml

from pipeline.cli import GROUPS, main
from pipeline.evaluation.rows import COLUMNS, row, table
from pipeline.report.pages import PAGES
from pipeline.studies import measured
from pipeline.studies.studies_file import read_studies
from tests.readers.logs import carmen_log
from tests.report.test_brief import results as brief_results
from tests.running.test_texts import BROKEN, broken

ROOT = Path(__file__).parents[1]


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the project's conf/, to call the command in."""
    shutil.copytree(ROOT / "conf", tmp_path / "conf")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def studies(project: Path) -> dict[str, dict[str, object]]:
    """The studies of conf/studies.yaml by name."""
    return yaml.safe_load((project / "conf/studies.yaml").read_text())["studies"]


def by_hand(project: Path, old: str, new: str, file: str = "studies") -> None:
    """Replace the first `old` in a file of conf/ by `new`, as a person would."""
    path = project / f"conf/{file}.yaml"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))


def study(project: Path) -> dict[str, object]:
    """The only study of conf/studies.yaml."""
    (only,) = studies(project).values()
    return only


def split(project: Path) -> tuple[object, object]:
    """The training and the test sequences of the only study."""
    return study(project)["train"], study(project)["tests"]


def keep_results(frame: pd.DataFrame) -> None:
    """Write a table as the results of the campus's study."""
    folder = Path("artifacts/results/campus")
    folder.mkdir(parents=True)
    frame.to_csv(folder / "results.csv", index=False)
    measured.write(folder, read_studies(Path("conf"))["campus"])


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line that a refused call prints."""
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 1
    *before, line = capsys.readouterr().err.splitlines()
    assert all("; try " in earlier_line for earlier_line in before)
    return line


def test_use_campus_writes_the_list_of_each_world(project):
    for world, tests in (("tiny", 2), ("demo", 5), ("year", 10)):
        main(["use", "campus", f"world={world}"])
        assert len(study(project)["tests"]) == tests
        assert study(project)["world"] == f"campus_{world}"


def test_a_copied_project_whose_venv_runs_the_code_of_another_says_so(project, capsys):
    (project / "pipeline/cli").mkdir(parents=True)
    line = f"the code of {ROOT} would run, not this folder's: `rm -r .venv && make install`"
    commands = "use campus|results|repro|repair|localize a.site scan.npy|inspect scan.npy"
    for words in commands.split("|"):
        assert line in refused(capsys, *words.split())
    (project / "pipeline/cli").rmdir()
    (project / "pipeline/cli").symlink_to(ROOT / "pipeline/cli")
    main(["use", "campus"])


def test_a_copy_of_the_code_among_the_packages_is_not_another_project(project, monkeypatch):
    (project / "pipeline/cli").mkdir(parents=True)
    among_packages = project / ".venv/site-packages/pipeline/cli/project.py"
    monkeypatch.setattr("pipeline.cli.project.__file__", str(among_packages))
    main(["use", "campus"])  # after `pip install '.[onnx]'`


def test_keep_leaves_an_added_sequence_but_not_another_world(project):
    main(["use", "campus", "world=demo"])
    by_hand(project, "    - '2013-04-05'\n", "    - '2013-04-05'\n    - '2013-02-23'\n")
    for world, kept in (("demo", True), ("tiny", False)):
        main(["use", "campus", f"world={world}", "--keep"])
        assert ("2013-02-23" in study(project)["tests"]) == kept


def test_studies_stand_side_by_side(project, capsys):
    main(["use", "campus", "town", "world=tiny"])
    assert list(studies(project)) == ["campus", "town"]
    assert "town: trained on 2014-07-14-14-49-50" in capsys.readouterr().out
    nclt(project / "data", "2012-01-15", "2012-02-04")
    for flags, there in ((["--add"], ["campus", "town", "nclt"]), ([], ["nclt"])):
        main(["use", "nclt", f"root={project / 'data'}", *flags])
        assert list(studies(project)) == there


def nclt(root: Path, *dates: str) -> None:
    """Make a folder of NCLT that looks complete for these dates; its files are empty."""
    for date in dates:
        (root / date / "velodyne_sync").mkdir(parents=True)
        (root / date / f"groundtruth_{date}.csv").touch()


def test_use_nclt_takes_what_is_on_disk_and_says_what_is_missing(project, capsys):
    root = project / "data"
    nclt(root, "2012-01-15", "2012-02-04", "2012-08-20")
    (root / "2012-03-17/velodyne_sync").mkdir(parents=True)
    main(["use", "nclt", f"root={root}"])
    said = capsys.readouterr().out
    assert study(project)["tests"] == ["2012-02-04", "2012-08-20"]
    assert study(project)["root"] == str(root)
    assert "2012-03-17: lacks groundtruth_2012-03-17.csv" in said
    assert "2013-04-05: not below" in said


def kitti(root: Path, *logs: str) -> None:
    """Make a folder of KITTI that looks complete for these logs; its files are empty."""
    (root / "poses").mkdir(parents=True)
    for log in logs:
        (root / f"sequences/{log}/velodyne").mkdir(parents=True)
        for path in (
            f"sequences/{log}/calib.txt",
            f"sequences/{log}/times.txt",
            f"poses/{log}.txt",
        ):
            (root / path).touch()


def test_use_kitti_splits_one_log(project):
    kitti(project / "kitti", "07")
    main(["use", "kitti", f"root={project / 'kitti'}"])
    assert split(project) == ("07-a", ["07-b"])


def test_use_splits_one_log_as_asked(project, capsys):
    carmen_log(project / "logs", name="drive.log")
    use = ("use", "carmen", f"root={project / 'logs'}")
    main([*use])
    assert split(project) == ("drive+path1of2+30s", ["drive+path2of2+30s"])
    main([*use, "split=visits:60"])
    assert split(project) == ("drive+first+60s", ["drive+later+60s"])
    main([*use, "train=drive+path1of4", "tests=drive+path3of4,drive+path4of4"])
    assert split(project) == ("drive+path1of4", ["drive+path3of4", "drive+path4of4"])
    refusals = {
        "split=halved": "expected path:2, time:3",
        "train=drive+path1of4 tests=drive": "the training sequence",
    }
    for words, part in refusals.items():
        assert part in refused(capsys, *use, *words.split())


def test_studies_do_not_change_while_dvc_works_on_them(project, capsys):
    main(["use", "campus", "world=tiny"])
    before = studies(project)
    (project / ".dvc/tmp").mkdir(parents=True)
    with (project / ".dvc/tmp/lock").open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        for words in ("use town", "use campus world=tiny budget=demo", "repair"):
            line = refused(capsys, *words.split())
            assert "`dvc` works in this folder, and nothing was changed" in line
        main(["use"])  # as `make dashboard` does to get their names
        main(["use", "campus", "world=tiny"])
    assert studies(project) == before
    main(["use", "town"])


def test_only_unperturbed_level_sweeps_have_poses(project, capsys):
    """Level sweeps are gathered along a path, and a perturbed query has none."""
    carmen_log(project / "logs", name="drive.log")
    use = ("use", "carmen", f"root={project / 'logs'}", "poses=sci_ring")
    main([*use, "scale=indoor"])
    text = (project / "conf/studies.yaml").read_text()
    assert "    poses:\n    - sci_ring\n" in text
    assert "submap: flat_10m" in text
    line = refused(capsys, *use, "experiment=robustness", "perturbed=turned")
    assert (
        "carmen: poses=sci_ring: level sweeps (submap flat_20m) are localised from unperturbed scans only"
        in line
    )


def test_an_option_that_nothing_would_read_is_refused(project, capsys):
    nclt(project / "data", "2012-01-15", "2012-02-04")
    carmen_log(project / "logs", name="drive.log")
    recorded = f"nclt root={project / 'data'}"
    split = f"carmen root={project / 'logs'}"
    for words, part in (
        (
            "suburb experiment=viewpoints poses=sad",
            "suburb experiment=viewpoints has no option poses",
        ),
        ("suburb experiment=viewpoints cells=5m", "has no option cells"),
        ("campus experiment=lifelong poses=sci", "campus experiment=lifelong has no option poses"),
        ("campus experiment=lifelong latency=yes", "has no option latency"),
        ("campus methods=m2dp,scan_context seeds=3", "of m2dp,scan_context draws at random"),
        (f"{recorded} log=2012-01-15", "log=2012-01-15: nclt splits no log"),
        (
            f"{split} split=time:2 train=drive+path1of4 tests=drive+path3of4",
            "split=time:2: train= and tests= name the splits already",
        ),
    ):
        assert part in refused(capsys, "use", *words.split())
    main(["use", "suburb", "world=tiny", "experiment=viewpoints", "poses=", "cells=", "latency=no"])
    main(["use", "campus", "experiment=lifelong"])
    assert "poses" not in study(project)


def test_use_kitti_for_viewpoints_trains_on_all_other_logs_that_are_there(project, capsys):
    kitti(project / "kitti", "00", "02", "08")
    words = ["use", "kitti", f"root={project / 'kitti'}", "experiment=viewpoints"]
    main(words)
    assert split(project) == ("02 08", ["00"])
    assert {method["view"] for method in study(project)["methods"]} == {"birdview"}
    assert "05: not below" in capsys.readouterr().out
    main([*words, "train=00", "tests=02,08"])
    assert split(project) == ("00", ["02", "08"])


MISTAKES = {
    "use campus latency=perhaps": "latency=perhaps: expected yes or no",
    "use suburb experiment=viewpoints methods=pfl,sci": "only methods that look at bird-views",
    "use town experiment=viewpoints": "experiment=viewpoints: of town expected year",
    "use suburb experiment=train": "expected year or robustness or viewpoints",
    "use campus seeds=0": "expected a number from 1 to 100",
    "use campus experiment=robustness methods=sci variants=engaged": "variants=engaged: expected some of 1way, 1way200, 24way, 4way, 4way200, 8way, 8way200, grey, text",
    "use campus experiment=robustness cells=10m": "cells=10m: expected some of 20m, 2m, 5m",
    "use campus variants=4way": "variants=4way: expected some of authors, engaged",
    "use suburb experiment=viewpoints variants=4way": "variants=4way: expected some of 30m, eight_headings, logistic, one_heading, paper, per_metre, unforgetting, untrained",
    "use campus perturbed=rain": "perturbed=rain: expected some of glance",
    "use campus experiment=robustness variants=5way": "variants=5way: expected some of 1way, 1way200, 24way, 4way, 4way200, 8way, 8way200, authors, engaged, grey, text",
    "use moon": "expected one of bag, campus",
    "use nclt": "root=FOLDER",
    "use nclt root=/nowhere": "no such folder",
    "use campus world=huge": "tiny, demo, nclt, year",
    "use campus root=/data": "no option root",
    "use campus tiny": "no data set tiny",
    "use root=/data": "of which data set?",
    "use campus tests=2011-01-01": "conf/world/campus_demo.yaml drives 2012-01-15",
    "use campus world=a\x1b[31mb\x07c": "world=a?[31mb?c: expected one of tiny",
    "use campus budget=rich": "budget=rich: expected one of demo, evening, full, minutes, night, papers, tiny",
    "inspect nothing.bin": "nothing.bin",
    "results": "dvc repro",
    "fetch kitti": "expected one of carmen, nclt, nclt_keyframes",
    "fetch nclt": "expected sequences to download, such as 2012-01-15",
    "fetch nclt 2012-01-15 base=http://127.0.0.1:9/": "cannot be reached",
    "inspect monday --save robot.yaml": "conf/dataset/NAME.yaml",
    "inspect monday --save conf/dataset/robot.yml": "conf/dataset/NAME.yaml",
    "inspect monday --save /nowhere/robot.yaml": "conf/dataset/NAME.yaml",
    "inspect monday --save conf/dataset/nclt.yaml": "there already",
}
"""Wrong words, and the values that the error expects."""


def test_a_mistake_is_one_line_that_says_what_was_expected(project, capsys):
    for words, part in MISTAKES.items():
        assert part in refused(capsys, *words.split()), words


def test_options_may_come_before_words_and_a_study_that_goes_is_named(project, capsys):
    main(["use", "campus", "town"])
    main(["use", "campus", "--keep", "poses=sci_ring"])
    assert studies(project)["campus"]["poses"] == ["sci_ring"]
    assert "town is no longer among the studies; --add keeps" in capsys.readouterr().out


def test_ctrl_c_is_one_line(project, capsys, monkeypatch):
    def stopped(conf):
        raise KeyboardInterrupt

    monkeypatch.setattr("pipeline.studies.catalogue.entries", stopped)
    with pytest.raises(SystemExit) as ended:
        main(["methods"])
    assert ended.value.code == 130
    assert capsys.readouterr().err == "yearloc methods: interrupted\n"


def test_a_broken_list_of_studies_is_rewritten(project, capsys):
    for text in ("studies: {campus: year}\n", "studies: [\n", ""):
        (project / "conf/studies.yaml").write_text(text)
        assert "yearloc use campus" in refused(capsys, "use")
        main(["use", "campus"])
        assert list(studies(project)) == ["campus"]


@pytest.mark.parametrize("how", BROKEN)
@pytest.mark.parametrize(
    ("file", "commands"),
    [
        (
            "studies",
            "use|results|results --full|repro|repair|picture a/b/c -o a.gif|pack a/b/c -o a",
        ),
        ("lists", "repro|repair"),
        ("method/sci", "methods|use campus|repair"),
        ("dataset/campus", "use campus|repair"),
        ("fetch/nclt", "fetch nclt 2012-01-15"),
    ],
)
def test_a_file_of_conf_that_cannot_be_read_is_one_line(project, capsys, file, commands, how):
    path = project / f"conf/{file}.yaml"
    broken(path, how)
    for command in commands.split("|"):
        # a missing file of another kind is none of those that there are
        if how != "missing" or file in ("studies", "lists"):
            assert str(path.relative_to(project)) in refused(capsys, *command.split()), command
    if file in ("studies", "lists"):
        main(["use", "campus", "world=tiny"])  # as the line says
        main(["repair"])


def test_a_training_sequence_that_is_missing_is_refused_with_those_on_disk(project, capsys):
    nclt(project / "data", "2012-02-04", "2012-03-17")
    line = refused(capsys, "use", "nclt", f"root={project / 'data'}")
    assert "one of 2012-02-04, 2012-03-17" in line


def test_a_sequence_that_cannot_be_read_is_named_with_its_reason(project, capsys):
    root = project / "own"
    use = ("use", "folder", f"root={project / 'own'}")
    for day in ("mon", "tue"):
        (root / day / "scans").mkdir(parents=True)
        (root / day / "scans/1.0.npy").touch()
    assert "mon: lacks poses.txt; tue: lacks poses.txt" in refused(capsys, *use)
    (root / "mon/poses.txt").touch()
    says = "one more is needed, or split=path:2 splits it, without train=; tue: lacks poses.txt"
    assert says in refused(capsys, *use, "train=mon")
    (root / "tue/poses.txt").touch()
    assert "is the training sequence" in refused(capsys, *use, "train=mon", "tests=mon")
    # what is trained on is no advice for a test, and two are no log to split
    for tests in ([], ["tests=tue"]):
        assert refused(capsys, *use, "train=mon,tue", *tests).endswith(": one more is needed")
    (root / "tue").rename(root / "tue 2")
    assert "rename it" in refused(capsys, *use)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("scans: scans", "scan: scans", "reader has no key scan: expected scans, poses"),
        ("scans: scans", "scans: [scans", "is no yaml"),
        ("readers.folder.Folder", "readers.folder.Holder", "no such reader"),
    ],
)
def test_a_slip_in_a_data_sets_yaml_is_one_line(project, capsys, old, new, said):
    by_hand(project, old, new, "dataset/folder")
    assert said in refused(capsys, "use", "folder", f"root={project}")


def test_a_study_by_hand_names_what_there_is(project, capsys):
    main(["use", "campus"])
    by_hand(project, "campus_demo", "moon")
    assert "campus: world=moon: expected one of campus_colonnade, campus_demo" in refused(
        capsys, "use"
    )
    main(["use", "campus"])
    by_hand(project, "    grids:", "    cells: [7m]\n    grids:")
    assert "campus: grid=7m: expected one of 10m" in refused(capsys, "use")


RESULTS = [
    row("auc_top1", "cells", 0.5, 0.25, 0.75) | {"method": "sci", "sequence": "may", "days": 20.0},
    row("auc_top1", "cells", 0.125) | {"method": "m2dp", "sequence": "may", "days": 20.0},
]


def test_results_are_printed_for_other_programs(project, capsys):
    main(["use", "campus"])
    keep_results(table(RESULTS, study="campus", dataset="campus", grid="10m"))
    capsys.readouterr()
    main(["results", "--csv", "--where", "method=sci,sad", "protocol=cells"])
    header, line = capsys.readouterr().out.splitlines()
    assert (header, line) == (
        ",".join(COLUMNS),
        "campus,campus,False,10m,sci,sci,,0,may,20.0,unperturbed,,0.0,0,cells,auc_top1,0.5,0.25,0.75",
    )
    main(["results", "--json"])
    first, second = json.loads(capsys.readouterr().out)
    assert (first["value"], second["low"], second["ask"]) == (0.5, None, "unperturbed")
    main(["results", "--where", "method=m2dp"])
    assert "0.125" in capsys.readouterr().out
    line = refused(capsys, "results", "--where", "speed=1")
    assert "expected one of the columns study, dataset" in line


def test_results_of_a_study_that_was_changed_since_are_reported_as_stale(project, capsys):
    main(["use", "campus", "methods=sci"])
    keep_results(table(RESULTS, study="campus", dataset="campus", grid="10m"))
    main(["results", "--csv"])
    assert capsys.readouterr().err == ""
    main(["use", "campus", "methods=sci", "budget=full"])
    main(["results", "--csv"])
    assert capsys.readouterr().err == (
        "campus: conf/studies.yaml changed after this was measured; `dvc repro` measures it again\n"
    )


@pytest.fixture
def pages(project: Path) -> Path:
    """The page README.md with a block that the study of the project fills; the others have none."""
    main(["use", "campus", "methods=sci"])
    keep_results(brief_results("campus"))
    (project / "docs").mkdir()
    for name in PAGES:
        Path(name).write_text(
            "<!-- results: campus demo brief -->\nold\n<!-- end of results -->\n"
            * (name == "README.md")
        )
    return project / "README.md"


def test_a_page_is_filled_whole_or_not_at_all(pages, monkeypatch):
    before = pages.read_text()
    whole = Path.write_text

    def killed(path, text, **how):
        whole(path, text[: len(text) // 2], **how)
        raise KeyboardInterrupt

    with monkeypatch.context() as during:
        during.setattr(Path, "write_text", killed)
        with pytest.raises(SystemExit):
            main(["results", "--write"])
    assert pages.read_text() == before
    main(["results", "--write"])
    assert "m0 " in pages.read_text()
    assert not list(pages.parent.rglob("*.scratch"))


def test_a_picture_of_a_model_that_the_study_has_not_is_left_as_it_is(pages, capsys):
    pages.write_text(
        "<!-- results: campus demo picture sci_ring-pose -->\nold\n<!-- end of results -->\n"
    )
    main(["results", "--write"])
    assert "README.md: campus demo picture sci_ring-pose: left as it is" in capsys.readouterr().out
    pages.write_text(pages.read_text() + pages.read_text().replace("sci_ring-pose", "sci"))
    line = refused(capsys, "results", "--write")
    assert "2 different pictures are wanted, and docs/year.gif holds one" in line


def test_what_the_papers_findings_read_is_kept_and_the_page_is_made_of_it(project, capsys):
    main(["use", "campus", "methods=sci"])
    keep_results(table(RESULTS, study="campus", dataset="campus", grid="10m"))
    main(["results", "--keep", "compare"])
    assert "docs/papers/compare.csv: written" in capsys.readouterr().out
    assert "0.125" in Path("docs/papers/compare.csv").read_text()
    made = Path("docs/papers/compare.yaml").read_text()
    assert all(key in made for key in ("made: '20", "torch ", "world: campus_demo"))
    assert "--keep mine: expected one of nway" in refused(capsys, "results", "--keep", "mine")
    Path("artifacts/results/campus/results.csv").unlink()  # the page is made of what is kept
    main(["results", "--write", "papers"])
    assert "`compare`" in Path("docs/papers.md").read_text()


def test_every_command_stands_in_a_group_of_the_help_with_a_sentence(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == 0
    about, *panels = capsys.readouterr().out.split("╭─ ")
    assert all(said in about for said in ("use nclt root=", "dvc repro"))
    rows = {
        panel.partition(" ")[0]: dict(re.findall(r"^│ (\w+) +(.*\.) +│$", panel, re.MULTILINE))
        for panel in panels
    }
    assert {name: [*rows[name.partition(" ")[0]]] for name in GROUPS} == {
        name: [command.__name__ for command in commands] for name, commands in GROUPS.items()
    }


MISTYPED = {
    "yearloc": "Missing command",
    "yearloc | metods": "No such command 'metods'. Did you mean 'methods'?",
    "yearloc | --jsn": "No such option: --jsn",
    "yearloc use | campus --kep": "No such option: --kep (Possible options: --help, --keep)",
    "yearloc use | campus --add=yes": "Option '--add' does not take a value",
    "yearloc methods | sci": "Got unexpected extra argument(s) (sci)",
    "yearloc localize": "Missing argument 'SITE'",
    "yearloc pack | campus/10m/sci": "Missing option '-o' / '--out'",
    "yearloc watch | a.site log --save": "Option '--save' requires an argument",
    "yearloc results | --csv --where": "Option '--where' requires an argument",
    "yearloc localize | a b --threads 1.5": "--threads 1.5: expected a valid integer, unable to parse string as an integer",
    "yearloc localize | a b --lift x\x1b[m": "--lift x?[m: expected a valid number, unable to parse string as a number",
    "yearloc update | a b --target-precision [red]x": "--target-precision [red]x: expected a valid number, unable to parse string as a number",
    "yearloc watch | a b --target-precision x": "--target-precision x: expected a share or the word none",
    "yearloc inspect | a --format pcd": "--format pcd: expected one of 'nclt', 'kitti', 'map'",
    "yearloc localize | a b --json --csv": "--csv: not together with --json",
    "yearloc localize | a b --lift 0 --body-T-lidar 0": "--body-T-lidar: not together with --lift",
    "yearloc results | method=sci": "method=sci: a word of --where or --write, and neither is there",
}
"""A command, the words after it, and the error."""


def test_a_mistyped_command_option_or_value_is_one_line(capsys):
    for line, mistake in MISTYPED.items():
        name, _, words = line.partition(" | ")
        with pytest.raises(SystemExit) as stop:
            main([*name.split()[1:], *words.split()])
        assert stop.value.code == 2
        printed = capsys.readouterr()
        assert printed.err == f"{name}: {mistake}; `{name} --help` shows what is needed\n"
        assert not printed.out


def test_shells_complete_commands_and_options():
    for words, found in (("yearloc loc", "localize"), ("yearloc use --ke", "--keep")):
        environment = {"COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
        done = yearloc(**environment, _YEARLOC_COMPLETE="complete_bash")
        assert done.stdout.split() == [found]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_installed_for_a_shell(tmp_path, shell):
    environment = {"HOME": str(tmp_path), "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    done = yearloc("--install-completion", shell, **environment)
    assert done.stdout.startswith(f"{shell} completion installed in {tmp_path}")
    scripts = [path for path in tmp_path.rglob("*yearloc*") if path.is_file()]
    assert ["_YEARLOC_COMPLETE" in script.read_text() for script in scripts] == [True]


def test_help_into_a_closed_pipe_is_no_error():
    done = subprocess.run(
        ["bash", "-c", '"$0" -m pipeline.cli --help | true; exit ${PIPESTATUS[0]}', sys.executable],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")


def yearloc(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Call the command in a process of its own, with some environment variables set."""
    return subprocess.run(
        [sys.executable, "-m", "pipeline.cli", *words],
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
