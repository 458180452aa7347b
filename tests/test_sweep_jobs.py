"""Which artifacts a job of a sweep builds, how jobs run in parallel, and which settings are
refused."""

import subprocess
from concurrent.futures import ThreadPoolExecutor

import pytest

from tests.clone import BIN, Clone
from tests.swept import Swept, outcome


@pytest.mark.slow
def test_a_views_field_builds_its_own_views_and_nothing_before_them(built: Clone) -> None:
    swept = Swept(built, "view.rings=20")
    assert swept.built == {"views", "train", "localize", "evaluate"}
    assert set(swept.jobs[0]["from_dvc"]) == {"scans", "submaps", "labels"}


def test_a_stages_field_costs_that_stage_and_what_follows(built: Clone) -> None:
    assert Swept(built, "localize.rejection.target_precision=0.5").built == {"localize", "evaluate"}
    assert Swept(built, "tolerance.bootstrap.resamples=50").built == {"evaluate"}


def test_a_failed_job_is_reported_and_the_others_finish(built: Clone) -> None:
    swept = Swept(built, "method.n_way=7,2")
    assert swept.code == 1
    assert "method.n_way=7: must divide the 48 sectors" in swept.jobs[0]["error"]
    assert "method.n_way=7: must divide" in swept.out
    assert "Traceback" not in swept.err
    assert swept.jobs[1]["error"] is None
    assert len(swept.value(1)) == 2


@pytest.mark.slow
def test_an_edit_since_the_last_repro_is_built_by_the_sweep_and_left_to_dvc(built: Clone) -> None:
    before = built.edit("conf/localize.yaml", "unseen_share: 0.2", "unseen_share: 0.3")
    try:
        assert Swept(built, "grid.cell_m=10").built == {"localize", "evaluate"}
        assert "localize" in {stage.partition("@")[0] for stage in built.outdated()}
    finally:
        (built.folder / "conf/localize.yaml").write_text(before)


@pytest.mark.slow
def test_sweeps_side_by_side_lose_and_spoil_nothing(built: Clone) -> None:
    """Two at once, each with two jobs at once; what they build by turns is what one builds
    alone."""
    overrides = (
        "hydra/launcher=joblib",
        "hydra.launcher.n_jobs=2",
        "localize.k=5,6",
        "grid.cell_m=10",
    )
    with ThreadPoolExecutor(2) as pool:
        one, other = pool.map(lambda _: Swept(built, *overrides), range(2))
    assert one.code == other.code == 0
    assert outcome(one) == outcome(other)
    # each artifact once
    assert sum(sum(job["built"].values()) for swept in (one, other) for job in swept.jobs) == 2 * 2
    assert outcome(Swept(built, "localize.k=5,6", "grid.cell_m=10"))[0][1] == outcome(one)[0][1]


@pytest.mark.slow
def test_slurms_preset_composes_and_submitit_runs_here(built: Clone) -> None:
    composed = built.run("python", "-m", "stages.sweep", "--cfg", "hydra", "hydra/launcher=slurm")
    assert "hydra_plugins.hydra_submitit_launcher.submitit_launcher.SlurmLauncher" in composed
    assert "cpus_per_task: 2" in composed
    swept = Swept(
        built,
        "hydra/launcher=submitit_local",
        "hydra.launcher.submitit_folder=.sweeps/slurm/%j",
        "localize.k=7,8",
    )
    assert swept.code == 0
    assert [len(swept.value(job)) for job in (0, 1)] == [2, 2]


@pytest.mark.slow
def test_optuna_looks_for_the_highest_auc_on_validation_blocks(built: Clone) -> None:
    swept = Swept(
        built,
        "hydra/sweeper=bayes",
        "hydra.sweeper.n_trials=3",
        "localize.rejection.unseen_share=interval(0.1,0.5)",
    )
    assert swept.code == 0
    assert len({job["overrides"]["localize.rejection.unseen_share"] for job in swept.jobs}) == 3
    best = max(value for job in range(3) for value in swept.value(job, "validation_auc"))
    assert f"best_value: {best}" in (swept.folder / "optimization_results.yaml").read_text()


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("grid.cel_m=5", "cel_m"),
        ("report.few=5", "report"),  # no job reads it
        ("dataset=nclt", "yearloc use"),
    ],
)
def test_a_setting_that_is_not_there_is_named(built: Clone, override: str, said: str) -> None:
    command = [str(BIN / "python"), "-m", "stages.sweep", "-m", override]
    done = subprocess.run(command, cwd=built.folder, env=built.env, capture_output=True, text=True)
    assert done.returncode == 1
    assert said in done.stdout + done.stderr
    assert "Traceback" not in done.stderr
