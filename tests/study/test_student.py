from scipy.special import stdtrit

from gtf_tune.study.outcome.student import upper_95


def test_student_quantiles_are_those_of_scipy_to_the_bit() -> None:
    freedoms = range(1, 121)

    assert [upper_95(freedom) for freedom in freedoms] == [float(stdtrit(freedom, 0.975)) for freedom in freedoms]
