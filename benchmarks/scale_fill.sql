INSERT INTO trials (trial_id, number, study_id, state, datetime_start, datetime_complete)
SELECT n + 1000000, n, %(optuna)s, 'COMPLETE', now(), now() FROM generate_series(0, %(last)s) n;
INSERT INTO trial_params (trial_id, param_name, param_value, distribution_json)
SELECT n + 1000000, 'filter.max_error', 0.01,
       '{"name": "FloatDistribution", "attributes": {"step": null, "low": 0.001, "high": 0.1, "log": true}}'
FROM generate_series(0, %(last)s) n;
INSERT INTO trial_values (trial_id, objective, value, value_type)
SELECT n + 1000000, 0, random(), 'FINITE' FROM generate_series(0, %(last)s) n;
INSERT INTO trial_intermediate_values (trial_id, step, intermediate_value, intermediate_value_type)
SELECT n + 1000000, s, random(), 'FINITE' FROM generate_series(0, %(last)s) n, generate_series(0, 5) s;
INSERT INTO gtf_trial (study_id, ordinal, optuna_trial_id, optuna_number, state, attempts, owner, host, machine, pid,
                       pid_started, options, value, feasible, gtf_ate, clean_runs, noisy_runs, wall_s, started_at,
                       message, detail)
SELECT %(ours)s, n, n + 1000000, n, 'complete', 1, '', '', '', 1, 1, '{"filter.max_error":0.01}', random(), true,
       random(), 2, 6, 1, 0, '', '{}'
FROM generate_series(0, %(last)s) n
