"""Environment variables that describe a job of several processes."""

import pytest

from gril_jax.cli.main import main
from gril_jax.errors import ConfigError
from gril_jax.runs.cluster import cluster_of

THREE = {"COORDINATOR_ADDRESS": "job-0.job:1234", "NUM_PROCESSES": "4", "PROCESS_ID": "3"}
SLURM = {"SLURM_JOB_ID": "1", "SLURM_NTASKS": "8", "SLURM_PROCID": "0"}


def test_three_variables_describe_a_job_also_inside_of_slurm():
    job = cluster_of(THREE)
    assert job == cluster_of(THREE | SLURM)
    assert (job["coordinator_address"], job["num_processes"]) == ("job-0.job:1234", 4)
    assert (job["process_id"], job["cluster_detection_method"]) == (3, "deactivate")


def test_slurm_alone_is_left_to_jax():
    assert cluster_of(SLURM) == {}


@pytest.mark.parametrize(
    ("environment", "sentence"),
    [
        ({}, "--distributed finds no job: start it by srun, or set COORDINATOR_ADDRESS"),
        ({"SLURM_JOB_ID": "1"}, "finds no job"),  # in a batch script, without srun
        ({**THREE, "PROCESS_ID": ""}, "COORDINATOR_ADDRESS is set, but PROCESS_ID is not"),
        ({"PROCESS_ID": "0"}, "PROCESS_ID is set, but COORDINATOR_ADDRESS is not"),
        (THREE | {"PROCESS_ID": "4"}, "PROCESS_ID is 4, but must be less than NUM_PROCESSES"),
        (THREE | {"NUM_PROCESSES": "four"}, "NUM_PROCESSES is 'four', but must be a whole number"),
        (THREE | {"COORDINATOR_ADDRESS": "job-0"}, "is 'job-0', but must be HOST:PORT"),
    ],
)
def test_anything_else_is_refused_in_one_sentence(environment, sentence):
    with pytest.raises(ConfigError, match=sentence):
        cluster_of(environment)


def test_the_command_line_is_refused_before_anything_is_imported(monkeypatch, capsys):
    for name in (*THREE, *SLURM):
        monkeypatch.delenv(name, raising=False)
    assert main(["sweep", "quickstart", "--distributed"]) == 2
    assert "--distributed finds no job" in capsys.readouterr().err
