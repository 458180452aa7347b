#!/bin/bash
# A SLURM of one node in a folder: tests/servers/slurm.sh FOLDER runs until it is ended. `SLURM_CONF=FOLDER/slurm.conf sbatch` uses it.
# Needs root and `apt-get install slurmctld slurmd slurm-client munge`.
set -eu
folder=$(mkdir -p "$1" && cd "$1" && pwd)
host=$(hostname -s)
mkdir -p "$folder"/{state,spool,munge}
chmod 711 "$folder"
head -c 128 /dev/urandom > "$folder/munge/key"
chmod 400 "$folder/munge/key"
cat > "$folder/slurm.conf" << END
ClusterName=one
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=16817
SlurmdPort=16818
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$folder/munge/socket
CryptoType=crypto/munge
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
ReturnToService=2
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
NodeName=$host NodeAddr=127.0.0.1 CPUs=2 RealMemory=4000 State=UNKNOWN
PartitionName=all Nodes=$host Default=YES MaxTime=INFINITE State=UP
END
trap 'kill $(jobs -p) 2> /dev/null || true' EXIT
munged --foreground --force --key-file="$folder/munge/key" --socket="$folder/munge/socket" --pid-file="$folder/munge/pid" \
    --log-file="$folder/munge/log" --seed-file="$folder/munge/seed" &
while [ ! -S "$folder/munge/socket" ]; do sleep 0.1; done
export SLURM_CONF=$folder/slurm.conf
slurmctld -D -f "$SLURM_CONF" &
slurmd -D -f "$SLURM_CONF" &
wait
