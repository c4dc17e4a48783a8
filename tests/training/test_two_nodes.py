"""Two nodes of a cluster, simulated by two process groups on one machine."""

import csv
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import torch

RECIPE = Path(__file__).parents[2] / "recipes" / "smoke.yaml"


@pytest.mark.slow
def test_two_nodes_train_one_model_and_write_one_log(tmp_path):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = [
        *("fit", "-c", str(RECIPE), "--trainer.max_epochs", "1", "--trainer.precision", "32-true"),
        *("--trainer.accelerator", "cpu", "--trainer.strategy", "ddp", "--trainer.devices", "1"),
        *("--trainer.num_nodes", "2", "--trainer.log_every_n_steps", "1", "--trainer.enable_progress_bar", "false"),
        *("--model.generator.volume_dims", "[8,8,4]", "--model.generator.projection_dim", "8"),
        *("--model.generator.decoder_dims", "[8,8]", "--model.encoder.channels", "[8,8,8,8]"),
        *("--data.num_objects", "4", "--data.num_views", "4", "--data.num_val_objects", "1", "--data.batch_size", "4"),
    ]
    nodes = []
    for rank in (0, 1):
        place = tmp_path / f"node{rank}"  # each with a disk of its own
        place.mkdir()
        variables = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": str(port), "NODE_RANK": str(rank), "LOCAL_RANK": "0"}
        variables |= {"WORLD_SIZE": "2", "GLOO_SOCKET_IFNAME": "lo"}
        command = [sys.executable, "-m", "kfit", *words]
        nodes.append(
            subprocess.Popen(
                command,
                cwd=place,
                env=os.environ | variables,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
        )
    ends = [node.communicate(timeout=600)[0] for node in nodes]
    assert [node.returncode for node in nodes] == [0, 0], "\n".join(ends)
    run = tmp_path / "node0" / "lightning_logs" / "version_0"
    last = torch.load(run / "checkpoints" / "last.ckpt", weights_only=True)
    assert last["kfit"]["processes"] == 2
    assert last["global_step"] == 2  # 16 pairs, 4 a process and step
    with (run / "metrics.csv").open() as table:
        assert any(row["val/l1"] for row in csv.DictReader(table))
    assert not list((tmp_path / "node1").rglob("*.ckpt"))
