# Another way to run a sweep, for who has Snakemake (it is not needed): every point is a rule of its own.
#
#   snakemake --cores 4 --config sweep=cases/sweeps/hopper.yaml
#
# Snakemake's own profiles and plug-ins then say where the rules run. What granpipe has done itself is not done again.
import subprocess

GRANPIPE = config.get("granpipe", ".venv/bin/granpipe")
SWEEP = config["sweep"]
RESULTS = config.get("results", "results")
RANKS = int(config.get("ranks", 1))

# checks every point, writes down what is to be run, and says where
listing = subprocess.run([GRANPIPE, "sweep", "run", SWEEP, "--results", RESULTS, "--write-only"], text=True, check=True,
                         capture_output=True).stdout.split()
FOLDER, MISSING = listing[0], listing[1:]


rule table:
    input: expand(f"{FOLDER}/points/{{point}}/provenance.json", point=MISSING)
    output: f"{FOLDER}/table.csv"
    shell: "{GRANPIPE} sweep table {FOLDER} || [ $? = 4 ]"


rule point:
    output: f"{FOLDER}/points/{{point}}/provenance.json"
    threads: RANKS
    shell: "GRANPIPE_CORES={threads} {GRANPIPE} sweep points --ranks {threads} {FOLDER} {wildcards.point}"
