"""A Slurm cluster of two nodes on the loopback of this machine, of Debian's packages and without systemd.

Everything of it lies in one folder, and it is ended by the process ids that it wrote there.
"""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "squeue", "scontrol")

PATIENCE = 900.0
"""Limit on whatever must come [s], however busy the machine is: nothing is shown by how soon it comes."""

CONFIG = """\
ClusterName=toy
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={root}/run/munge.sock
CredType=cred/munge
SlurmctldPort={ports[0]}
StateSaveLocation={root}/state
SlurmdSpoolDir={root}/spool/%n
TmpFS={root}/tmp/%n
SlurmctldPidFile={root}/run/slurmctld.pid
SlurmdPidFile={root}/run/slurmd.%n.pid
SlurmctldLogFile={root}/log/slurmctld.log
SlurmdLogFile={root}/log/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SwitchType=switch/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=1,sched_interval=5
ReturnToService=2
JobRequeue=1
KillWait=5
MinJobAge=3600
SlurmdParameters=config_overrides
NodeName=n1 NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[1]} CPUs=1 RealMemory=2000 State=UNKNOWN
NodeName=n2 NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[2]} CPUs=1 RealMemory=2000 State=UNKNOWN
PartitionName=main Nodes=n1,n2 Default=YES MaxTime=INFINITE State=UP
"""


class TwoNodes:
    """A running cluster: `environment` is what its commands need."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.config = root / "slurm.conf"
        self.environment = os.environ | {"SLURM_CONF": str(self.config)}

    def run(self, *command: str) -> str:
        """Output of one command of Slurm."""
        done = subprocess.run(
            command, env=self.environment, capture_output=True, text=True, check=False, timeout=PATIENCE
        )
        assert done.returncode == 0, f"{command}: {done.stderr}{done.stdout}"
        return done.stdout

    def queue(self) -> list[tuple[str, str, str]]:
        """(job, state, node) of every element that waits or runs."""
        lines = self.run("squeue", "--array", "--noheader", "--format=%i|%T|%N").splitlines()
        return [(job, state, node) for job, state, node in (line.split("|") for line in lines)]

    def node_states(self) -> dict[str, str]:
        """Node → idle, allocated, draining, drained, down, …"""
        lines = self.run("sinfo", "--noheader", "--Node", "--format=%N %T").splitlines()
        return {name: state.rstrip("*~#!%$@^-") for name, state in (line.split() for line in lines)}

    def wait_until_up(self) -> None:
        """Wait until both nodes take jobs; one that was lost comes back by itself."""
        up = {"idle", "allocated", "mixed", "completing"}
        wait_for(lambda: set(self.node_states().values()) <= up)

    def start(self, node: str) -> None:
        """Start the daemon of a node."""
        self._daemon("slurmd", "-f", str(self.config), "-N", node)

    def end(self, name: str, how: int = signal.SIGTERM) -> None:
        """End the daemon whose process id is in ``run/<name>.pid``, and wait for its end."""
        file = self.root / "run" / f"{name}.pid"
        with contextlib.suppress(FileNotFoundError, ProcessLookupError, ValueError):
            pid = int(file.read_text())
            os.kill(pid, how)
            wait_for(lambda: not alive(pid), 20)

    def _begin(self) -> None:
        for folder in ("run", "log", "state", "spool/n1", "spool/n2", "tmp/n1", "tmp/n2"):
            (self.root / folder).mkdir(parents=True)
        self.config.write_text(CONFIG.format(host=socket.gethostname().split(".")[0], root=self.root, ports=_ports(3)))
        key = self.root / "munge.key"
        key.touch(mode=0o600)
        key.write_bytes(os.urandom(128))
        run = self.root / "run"
        self._daemon(
            "munged", "--force", f"--key-file={key}", f"--socket={run}/munge.sock", f"--pid-file={run}/munged.pid",
            f"--log-file={self.root}/log/munged.log", f"--seed-file={self.root}/munge.seed",
        )  # fmt: skip
        self._daemon("slurmctld", "-f", str(self.config))
        for node in ("n1", "n2"):
            self.start(node)
        self.wait_until_up()

    def _daemon(self, program: str, *arguments: str) -> None:
        path = shutil.which(program) or shutil.which(program, path="/usr/sbin:/sbin")
        assert path, f"{program} is not installed"
        done = subprocess.run([path, *arguments], capture_output=True, text=True, check=False, timeout=PATIENCE)
        assert done.returncode == 0, f"{program} does not start: {done.stderr}{done.stdout}"

    def _end(self) -> None:
        with contextlib.suppress(AssertionError, subprocess.TimeoutExpired):
            self.run("scancel", "--me")
            wait_for(lambda: not self.queue(), 20)
        for name in ("slurmd.n1", "slurmd.n2", "slurmctld", "munged"):
            self.end(name)
            self.end(name, signal.SIGKILL)


def missing() -> list[str]:
    """Programs of Slurm that are not here."""
    return [name for name in PROGRAMS if not (shutil.which(name) or shutil.which(name, path="/usr/sbin:/sbin"))]


@contextlib.contextmanager
def two_nodes(root: Path) -> Iterator[TwoNodes]:
    """A cluster that lives as long as the block; its logs stay in the folder."""
    cluster = TwoNodes(root)
    try:
        cluster._begin()
        yield cluster
    finally:
        cluster._end()


def wait_for(condition: Callable[[], bool], seconds: float = PATIENCE, every: float = 0.2) -> None:
    """Wait until `condition()` holds; AssertionError when it takes too long."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"nothing came of it in {seconds:g} s"
        time.sleep(every)


def alive(pid: int) -> bool:
    """Whether a process is there and not merely waiting to be noticed."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def _ports(number: int) -> list[int]:
    """Free ports, all different, below those that the kernel hands out: nobody takes one before its daemon does."""
    found: list[int] = []
    for port in random.sample(range(20_000, 32_000), 200):
        with socket.socket() as one, contextlib.suppress(OSError):
            one.bind(("127.0.0.1", port))
            found.append(port)
    return found[:number]
