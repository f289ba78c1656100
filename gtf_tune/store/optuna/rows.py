"""Tables of Optuna that are read by SQL, without Optuna, and what gtf-tune keeps in them."""

from sqlalchemy import column, table

NUMBER_KEY = "gtf_tune:slot"
"""System attribute of a trial with its number in the study's budget; enqueued trials have none."""

TRIALS = table("trials", column("trial_id"), column("number"), column("study_id"), column("state"))
TRIAL_ATTRIBUTES = table("trial_system_attributes", column("trial_id"), column("key"), column("value_json"))
STUDY_ATTRIBUTES = table("study_system_attributes", column("study_id"), column("key"))
