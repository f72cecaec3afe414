"""Jobs that SLURM would let wait for good, and what is mended of Snakemake's plugin for it."""

import asyncio
import logging

import pytest

from silmesh.planning.slurm import judge_partition, remember_jobs

PARTITION = {"PartitionName": "short", "State": "UP", "MaxTime": "1-00:30:00"}
HALF_A_DAY, TWO_DAYS = 12 * 60, 48 * 60  # minutes


@pytest.mark.parametrize(
    ("partition", "account", "minutes", "why"),
    [
        ({}, "", HALF_A_DAY, ""),
        ({}, "", 24 * 60 + 30, ""),
        ({}, "", TWO_DAYS, "partition short has a limit of 1-00:30:00"),
        ({"MaxTime": "UNLIMITED"}, "", TWO_DAYS, ""),
        ({"State": "DRAIN"}, "", 1, "partition short is drain"),
        ({"AllowAccounts": "ALL"}, "anna", 1, ""),
        ({"AllowAccounts": "lab,anna"}, "anna", 1, ""),
        ({"AllowAccounts": "lab"}, "anna", 1, "no jobs of account anna, only those of lab"),
        ({"AllowAccounts": "lab"}, "", 1, "no jobs without an account, only those of lab"),
    ],
)
def test_a_partition_that_lets_a_job_wait_for_good(partition, account, minutes, why):
    said = judge_partition(PARTITION | partition, account, minutes)
    assert said.endswith(why)
    assert bool(said) == bool(why)


def ask(plugin, command: str):
    return asyncio.run(plugin.query_job_status(command, logging.getLogger()))


def test_jobs_of_which_slurm_cannot_tell_are_not_forgotten(monkeypatch):
    plugin = pytest.importorskip("snakemake_executor_plugin_slurm")
    monkeypatch.setattr(plugin, "query_job_status", plugin.query_job_status)
    assert ask(plugin, "false")[0] is None  # the plugin drops all jobs then
    remember_jobs()
    assert ask(plugin, "false")[0] == {}  # it has not heard of them yet
    assert ask(plugin, "echo 17|RUNNING")[0] == {"17": "RUNNING"}
