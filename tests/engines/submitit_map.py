import sys

import submitit

PARTS = 7


def part(k):
    over = ["--over", "oscillator.h=log:1e-3:4e-3:6", "--over", "oscillator.zeta=[0.005,0.01,0.02]"]
    command = ["vibroimpact", "map", "scene.toml", *over]
    command += ["--part", f"{k}/{PARTS}", "--threads", "1", "--out", "map"]
    try:
        return submitit.helpers.CommandFunction(command)()
    except submitit.helpers.FailedJobError as error:
        if "exited with return code 3" in str(error):
            return str(error)  # every line is written, some with a message
        raise


if __name__ == "__main__":
    # On the cluster: cluster="slurm"; here: "local", processes of this machine.
    executor = submitit.AutoExecutor(folder="logs", cluster=sys.argv[1] if len(sys.argv) > 1 else None)
    executor.update_parameters(timeout_min=60, cpus_per_task=1)
    jobs = executor.map_array(part, range(1, PARTS + 1))
    for job in jobs:
        job.result()
