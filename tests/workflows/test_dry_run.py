"""A dry run tells what would be done, and no more."""

from gril_jax.cli import main

SMALL = (
    "--ppo.num-envs=8 --ppo.unroll-length=4 --ppo.num-minibatches=2 --ppo.hidden 8 "
    "--ppo.num-timesteps=64 --run.evaluations=0"
).split()


def test_a_reward_that_is_not_learned_is_not_timed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    args = ["train", "quickstart", "--reward", "environmental", "--dry-run", *SMALL]
    assert main.main(args) == 0
    policy, total = capsys.readouterr().out.splitlines()
    assert policy.startswith("policy: 64 env steps by PPO")
    assert "demonstrations" not in total
    assert not [*tmp_path.iterdir()]
