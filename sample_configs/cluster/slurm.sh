#!/bin/bash
# Starts Ray on the nodes of a Slurm job, and a run on it. Not tested on real machines. For example:
#
#     sbatch --nodes=4 slurm.sh my.yaml --take /mnt/takes/first
#
# Add what your nodes need, such as --gpus-per-node=1 or --partition=gpu. A job that is preempted starts again, and its run
# resumes. `ray get-auth-token --generate` must have been called once; all nodes read ~/.ray/auth_token.
#SBATCH --job-name=v3studio
#SBATCH --ntasks-per-node=1
#SBATCH --exclusive
#SBATCH --requeue
#SBATCH --open-mode=append
set -eu
export RAY_AUTH_MODE=token RAY_USAGE_STATS_ENABLED=0
head=$(hostname -I | cut -d ' ' -f 1)  # this script runs on the first node
ray start --head --node-ip-address="$head" --port=6379 --include-dashboard=false
if [ "$SLURM_NNODES" -gt 1 ]; then
    srun --nodes=$((SLURM_NNODES - 1)) --ntasks=$((SLURM_NNODES - 1)) --exclude="$(hostname)" \
        ray start --address="$head:6379" --block &
fi
v3studio run "$@" --run.executor ray --run.address "$head:6379"
