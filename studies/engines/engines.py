#!/usr/bin/env python3
"""One study and one fit from many starts, by every engine on this machine, with and without workers that are killed: whether the result
is that of the one command to the byte, and what the engine costs.

    cargo build --release && python/wheel
    studies/engines/prepare.sh
    target/engines/venv/bin/pip install target/wheels/fdm-*.whl
    target/engines/venv/bin/python studies/engines/engines.py

Efficiency is the time of the command on one thread over twice the time of the engine, start and merging included. Overhead is what the two
cores spend beyond that time, for each task. Kubernetes is a fake that does what an Indexed Job does. Without the wheel,
name the others by `--only`.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

MODEL = """model bend "two rates that are hard to tell apart" {
  state a = 3, b = 0;
  param k1 = 0.5 in [0.01, 10] [1/s], k2 = 0.1 in [0.01, 10] [1/s], c = 0 in [-1, 1];
  der(a) = -k1*a;
  der(b) = k1*a - k2*b/(1 + b^2);
  output y = b + c;
}
"""

HYPERQUEUE = """import json, subprocess, sys
from hyperqueue import Job, LocalCluster
from hyperqueue.cluster import WorkerConfig

fdm, shards = sys.argv[1], int(sys.argv[2])
with LocalCluster() as cluster:
    cluster.start_worker(WorkerConfig(cores=2))
    client = cluster.client()
    for attempt in range(100):
        job = Job(max_fails=None)
        for k in range(1, shards + 1):
            words = [fdm, "run", "job.plan", "--shard", f"{k}/{shards}", "--out", "job.tasks", "--threads", "1", "--quiet"]
            job.program(words, stdout=None, stderr=None)
        client.wait_for_jobs([client.submit(job)], raise_on_error=False)
        status = subprocess.run([fdm, "status", "job.tasks", "--json"], capture_output=True, text=True).stdout
        if not json.loads(status)["missing"]:
            break
"""


def record(samples: int) -> str:
    """A record of the model, with a ripple that takes the place of noise."""
    from math import exp, sin

    rows = ["t [s],y"]
    for n in range(samples):
        t = 10.0 * n / samples
        rows.append(f"{t!r},{3.0 * (exp(-0.3 * t) - exp(-1.2 * t)) + 0.02 * sin(n * n + 0.4)!r}")
    return "\n".join(rows) + "\n"


class Killer(threading.Thread):
    """Kills a program that works on a shard of this folder, again and again."""

    def __init__(self, folder: Path, pause: float, rng: random.Random):
        super().__init__(daemon=True)
        self.folder, self.pause, self.rng = str(folder), pause, rng
        self.kills, self.over = 0, threading.Event()

    def run(self) -> None:
        while not self.over.wait(self.rng.uniform(0.5, 1.5) * self.pause):
            shards = [pid for pid in self.processes()]
            if shards:
                try:
                    os.kill(self.rng.choice(shards), signal.SIGKILL)
                    self.kills += 1
                except ProcessLookupError:
                    pass

    def processes(self) -> list[int]:
        """Programs that this study has started: they name its folder, or work in it, and a shard."""
        found = []
        for entry in Path("/proc").iterdir():
            if not entry.name.isdigit():
                continue
            try:
                words = (entry / "cmdline").read_bytes().split(b"\0")
                here = os.readlink(entry / "cwd")
            except OSError:
                continue
            if b"run" in words[:4] and b"--shard" in words and (here.startswith(self.folder) or self.folder.encode() in b" ".join(words)):
                if not any(word.endswith((b"mpirun", b"parallel", b"hq", b"perl", b"bash")) for word in words[:2]):
                    found.append(int(entry.name))
        return found


class Study:
    def __init__(self, options: argparse.Namespace):
        self.options = options
        self.fdm = Path(options.fdm).absolute()
        self.engines = Path(options.engines).absolute()
        self.work = Path(options.work).absolute()
        shutil.rmtree(self.work, ignore_errors=True)
        self.work.mkdir(parents=True)
        (self.work / "bend.fdm").write_text(MODEL)
        (self.work / "run.csv").write_text(record(options.samples))
        root = self.engines / "root"
        paths = [root / "usr/bin", root / "usr/sbin", self.engines / "venv/bin"]
        machine = root / "usr/lib/x86_64-linux-gnu"
        libraries = [machine, machine / "slurm-wlm", root / "lib/x86_64-linux-gnu"]
        self.environment = {
            **os.environ,
            "FDM": str(self.fdm),
            "PATH": os.pathsep.join([*map(str, paths), os.environ["PATH"]]),
            "LD_LIBRARY_PATH": os.pathsep.join(map(str, libraries)),
            "OPAL_PREFIX": str(root / "usr"),
            "OPAL_LIBDIR": str(machine),
            "OPAL_PKGLIBDIR": str(machine / "openmpi"),
            "OPAL_DATADIR": str(root / "usr/share"),
            "OPAL_PKGDATADIR": str(root / "usr/share/openmpi"),
            "OPAL_SYSCONFDIR": str(root / "etc"),
            "OMPI_MCA_mca_base_component_path": str(machine / "openmpi/lib/openmpi3"),
            "OMPI_ALLOW_RUN_AS_ROOT": "1",
            "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
            "PERL5LIB": str(root / "usr/share/perl5"),
            "JOBS": "2",
            "RANKS": "2",
            "RAY_DEDUP_LOGS": "0",
        }

    def call(self, words: list[str], where: Path, check: bool = True) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(words, cwd=where, env=self.environment, capture_output=True, text=True, check=False)
        if check and done.returncode not in (0, 1):
            raise RuntimeError(f"{' '.join(words)}: {done.returncode}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}")
        return done

    def started(self, words: list[str], where: Path, name: str) -> subprocess.Popen[bytes]:
        log = open(where / f"{name}.log", "wb")
        return subprocess.Popen(words, cwd=where, env=self.environment, stdout=log, stderr=log)

    # --- engines: each does the script that `fdm plan --for` has written ---

    def script(self, where: Path, engine: str) -> None:
        done = self.call(["bash", f"job.{engine}.sh"], where)
        (where / "engine.log").write_text(done.stdout[-4000:] + done.stderr[-4000:])

    def parallel(self, where: Path) -> None:
        self.script(where, "parallel")

    def mpi(self, where: Path) -> None:
        self.environment["MPIRUN"] = "mpirun --oversubscribe --bind-to none --mca plm isolated --mca btl self,tcp"
        self.script(where, "mpi")

    def hq(self, where: Path) -> None:
        # the wheel has HyperQueue's server and workers, and its Python door in the place of the command `hq`
        (where / "hq.py").write_text(HYPERQUEUE)
        words = [str(self.engines / "venv/bin/python"), "hq.py", str(self.fdm), str(self.options.shards)]
        done = self.call(words, where)
        (where / "engine.log").write_text(done.stdout[-4000:] + done.stderr[-4000:])
        self.call([str(self.fdm), "merge", "job.tasks"], where)

    def slurm(self, where: Path) -> None:
        host = os.uname().nodename.split(".")[0]
        lib = self.engines / "root/usr/lib/x86_64-linux-gnu/slurm-wlm"
        state = where / "slurm"
        state.mkdir()
        (state / "slurm.conf").write_text(
            f"ClusterName=here\nSlurmctldHost={host}(127.0.0.1)\nAuthType=auth/none\nCredType=cred/none\n"
            f"PluginDir={lib}\nSlurmUser=root\nSlurmdUser=root\nStateSaveLocation={state}\nSlurmdSpoolDir={state}/spool\n"
            f"SlurmctldPidFile={state}/ctld.pid\nSlurmdPidFile={state}/d.pid\nSlurmctldPort=16817\nSlurmdPort=16818\n"
            f"ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nSelectType=select/cons_tres\nReturnToService=2\n"
            f"SlurmctldLogFile={state}/ctld.log\nSlurmdLogFile={state}/d.log\nMpiDefault=none\nSwitchType=switch/none\n"
            f"JobAcctGatherType=jobacct_gather/none\nAccountingStorageType=accounting_storage/none\nSchedulerType=sched/builtin\n"
            f"NodeName={host} NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN\nPartitionName=all Nodes={host} Default=YES State=UP\n"
        )
        self.environment["SLURM_CONF"] = str(state / "slurm.conf")
        control = self.started(["slurmctld", "-D", "-i"], where, "slurmctld")
        time.sleep(1.0)
        daemon = self.started(["slurmd", "-D", "-N", host, "-d", str(self.engines / "root/usr/sbin/slurmstepd")], where, "slurmd")
        try:
            for _ in range(100):
                if "idle" in self.call(["sinfo", "-h", "-o", "%t"], where, check=False).stdout:
                    break
                time.sleep(0.2)
            done = self.call(["sbatch", "--wait", "job.slurm.sh"], where, check=False)
            (where / "engine.log").write_text(done.stdout + done.stderr)
            self.call([str(self.fdm), "merge", "job.tasks"], where)
        finally:
            for process in (daemon, control):
                process.terminate()
                process.wait()

    def dask(self, where: Path) -> None:
        self.python(where, "dask")

    def ray(self, where: Path) -> None:
        self.python(where, "ray")

    def python(self, where: Path, engine: str) -> None:
        done = self.call([str(self.engines / "venv/bin/python"), f"job.{engine}.py"], where)
        (where / "engine.log").write_text(done.stdout[-4000:] + done.stderr[-4000:])

    def k8s(self, where: Path) -> None:
        """A fake of what Kubernetes does with the Indexed Job: its command under each index, again after a failure unless that is 2."""
        text = (where / "job.k8s.yaml").read_text()
        words = json.loads(next(line for line in text.splitlines() if "command:" in line).split("command:")[1])
        count = int(next(line for line in text.splitlines() if "completions:" in line).split(":")[1])

        def pod(index: int) -> int:
            environment = {**self.environment, "JOB_COMPLETION_INDEX": str(index)}
            for _ in range(101):
                words_of_pod = [str(self.fdm), *words[1:]]
                code = subprocess.run(words_of_pod, cwd=where, env=environment, capture_output=True, check=False).returncode
                if code in (0, 2):
                    return code
            return 1

        with ThreadPoolExecutor(2) as nodes:
            if any(nodes.map(pod, range(count))):
                raise RuntimeError("an index has failed")
        self.call([str(self.fdm), "merge", "job.tasks"], where)

    # --- the table ---

    def job(self, kind: str) -> tuple[str, list[str], int]:
        if kind == "study":
            count = self.options.repeats
            return f"command = 'study'\nrepeats = {count}\nseed = 4\n", ["study", "--repeats", str(count), "--seed", "4"], count
        count = self.options.starts
        return f"command = 'fit'\nstarts = {count}\nseed = 3\n", ["fit", "--starts", str(count), "--seed", "3"], count

    def rows(self, kind: str) -> bool:
        text, words, count = self.job(kind)
        times, results = {}, []
        for threads in (1, 2):
            out = self.work / f"{kind}-{threads}"
            command = [str(self.fdm), words[0], "bend.fdm", "--data", "run.csv", *words[1:]]
            begun = time.perf_counter()
            self.call([*command, "-q", "--threads", str(threads), "--out", str(out)], self.work)
            times[threads] = time.perf_counter() - begun
            results.append((out / "result.json").read_bytes())
        same = results[0] == results[1]
        self.row(kind, "1 thread", count, times[1], 0, times[1], same, cores=1)
        self.row(kind, "2 threads", count, times[2], 0, times[1], same)
        for engine in self.options.only:
            for pause in (0.0, self.options.kill):
                same &= self.one(kind, (text, count), engine, pause, (times[1], results[0]))
        return same

    def one(self, kind: str, job: tuple[str, int], engine: str, pause: float, expected: tuple[float, bytes]) -> bool:
        text, count = job
        where = self.work / f"{kind}-{engine}{'-killed' if pause else ''}"
        where.mkdir()
        for name in ("bend.fdm", "run.csv"):
            shutil.copy(self.work / name, where / name)
        (where / "job.toml").write_text(text + "model = 'bend.fdm'\ndata = 'run.csv'\nquiet = true\nout = 'merged'\n")
        python = engine in ("dask", "ray")
        program = [str(self.engines / "venv/bin/python"), "-m", "fdm"] if python else [str(self.fdm)]
        shards = str(self.options.shards)
        self.call([*program, "plan", "job.toml", "-q", "--untimed", "--for", engine, "--shards", shards], where)
        killer = Killer(where, pause, random.Random(f"{kind} {engine}"))
        if pause:
            killer.start()
        begun = time.perf_counter()
        try:
            getattr(self, engine)(where)
            result = (where / "merged/result.json").read_bytes()
        except (RuntimeError, OSError) as e:
            result = b""
            print(f"{engine}: {e}", file=sys.stderr)
        elapsed = time.perf_counter() - begun
        killer.over.set()
        same = result == expected[1]
        self.row(kind, engine, count, elapsed, killer.kills, expected[0], same)
        return same

    def row(self, kind: str, engine: str, count: int, elapsed: float, kills: int, alone: float, same: bool, cores: int = 2) -> None:
        spent = cores * elapsed
        overhead = 1e3 * (spent - alone) / count
        print(
            f"{kind:6} {engine:10} {count:7} {elapsed:8.1f} s {kills:5} kills   efficiency {alone / spent:5.3f}"
            f"   overhead {overhead:8.3f} ms a task   {'the same bytes' if same else 'OTHER BYTES'}",
            flush=True,
        )


def main() -> int:
    engines = ["parallel", "slurm", "hq", "dask", "ray", "mpi", "k8s"]
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--fdm", default="target/release/fdm")
    parser.add_argument("--engines", default=os.environ.get("FDM_ENGINES", "target/engines"))
    parser.add_argument("--work", default="target/engines/work")
    parser.add_argument("--repeats", type=int, default=10_000)
    parser.add_argument("--starts", type=int, default=2_000)
    parser.add_argument("--samples", type=int, default=400)
    parser.add_argument("--shards", type=int, default=20)
    parser.add_argument("--kill", type=float, default=3.0, help="seconds between two kills, on the average")
    parser.add_argument("--only", nargs="+", choices=engines, default=engines)
    parser.add_argument("--kinds", nargs="+", choices=["study", "starts"], default=["study", "starts"])
    options = parser.parse_args()
    study = Study(options)
    found = [study.rows(kind) for kind in options.kinds]
    return 0 if all(found) else 1


if __name__ == "__main__":
    sys.exit(main())
