"""Events are put together anew only when there are other ones, and a flood of notices does not keep the screen busy."""

from canarm_tui.faults import Faults
from canarm_tui.gathered import Gathered
from canarm_tui.news import News
from canarm_tui.notices import Kind, Notice, Notices

S = 1_000_000_000


def notice(cycle):
    return Notice(0, cycle, Kind.EMERGENCY, f"EMCY in cycle {cycle}")


def test_a_flood_of_notices_is_gathered_a_few_times_a_second():
    gathered, notices, faults = Gathered(), Notices(), Faults()
    seen = []
    for place in range(1, 101):
        notices.add(notice(1000 * place))
        gathered.gather(faults, [notices], S + place * S // 100)
        seen.append(gathered.all_of_them)
    assert len(set(map(id, seen))) <= 6, "in one second"
    assert gathered.of_bench == ()


def test_without_anything_new_the_events_stay_the_same_objects():
    gathered, notices, faults = Gathered(), Notices(), Faults()
    notices.add(notice(1))
    gathered.gather(faults, [notices], S)
    before = gathered.all_of_them
    gathered.gather(faults, [notices], 10 * S)
    assert gathered.all_of_them is before
    gathered.gather(Faults(), [notices], 10 * S)
    assert gathered.all_of_them is not before


def test_news_are_drawn_at_once_and_without_any_after_a_while():
    news = News(S)
    assert [news.is_due("a", at * S // 4) for at in range(6)] == [True, False, False, False, True, False]
    assert news.is_due("b", 6 * S // 4)
