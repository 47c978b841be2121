"""One rule for many items as one test, which names every item that breaks it: thousands of tests cost more than the rules."""


def each(items, name_of=str):
    """Make a test of one item a test of all of them."""
    rows = list(items)
    assert rows

    def of_all(rule):
        def test():
            broken = []
            for item in rows:
                try:
                    rule(item)
                except AssertionError as error:
                    broken.append(f"{name_of(item)}: {error}")
            assert not broken, "\n".join(broken)

        test.__name__, test.__doc__ = rule.__name__, rule.__doc__
        return test

    return of_all
