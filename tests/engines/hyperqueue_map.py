from pathlib import Path

from hyperqueue import Job, LocalCluster
from hyperqueue.cluster import WorkerConfig

PARTS = 7
OVER = "--over oscillator.h=log:1e-3:4e-3:6 --over oscillator.zeta=[0.005,0.01,0.02]"

if __name__ == "__main__":
    # A server and two workers of one core each; on a cluster: hyperqueue.Client() of a server that runs there.
    with LocalCluster() as cluster:
        for _ in range(2):
            cluster.start_worker(WorkerConfig(cores=1))
        job = Job(default_workdir=Path.cwd(), max_fails=None)
        for k in range(1, PARTS + 1):
            line = f"vibroimpact map scene.toml {OVER} --part {k}/{PARTS} --threads 1 --out map"
            # 3: every line is written, and some say that a point failed or missed the tolerance.
            job.program(["sh", "-c", f"{line} || [ $? -eq 3 ]"], name=f"part-{k}")
        client = cluster.client()
        client.wait_for_jobs([client.submit(job)])
