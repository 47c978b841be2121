"""Memory diagrams of one Hertz-Mindlin contact on a line: the independent judge of the law `exact`.

D(q) in [-1, 1] on [0, d] says which share of friction the contact carries that was made between overlap q and q + dq:
T = mu int D dN and s = kappa int D dq. Source: V. Aleshin, O. Bou Matar, K. Van Den Abeele, Method of memory diagrams for
mechanical frictional contacts subject to arbitrary 2D loading, Int. J. Solids Struct. 60-61 (2015). Numbers are floats or
mpmath's."""


class MemoryDiagram:
    """A contact with N = stiffness d^1.5, friction mu, kappa = mu E*/G*; positive slip gives positive T."""

    def __init__(self, stiffness, mu, kappa):
        self.stiffness, self.mu, self.kappa = stiffness, mu, kappa
        self.overlap = 0.0
        self.pieces: list[tuple] = []  # (q_1, q_2, D), rising

    def move(self, overlap, slip):
        """Along a straight segment to `overlap` while slipping by `slip`; a negative overlap forgets all."""
        old, kappa = self.overlap, self.kappa
        if overlap <= 0.0:
            self.overlap, self.pieces = overlap, []
            return
        if old < 0.0:
            slip, old = slip * overlap / (overlap - old), 0.0
        grown = overlap - old
        self.overlap = overlap
        if grown > 0.0 and abs(slip) <= kappa * grown:
            self.pieces.append((old, overlap, slip / (kappa * grown)))
            return
        target = kappa * sum(share * (b - a) for a, b, share in self.pieces) + slip
        # for a smaller overlap: what is asked beyond the slip that the lost part of the diagram gives back
        excess = slip if grown >= 0.0 else target - kappa * self._content(overlap)
        if excess == 0.0:
            self.pieces = self._cut(overlap)
            return
        sign = 1.0 if excess > 0.0 else -1.0
        within = self._cut(overlap)
        for k in range(len(within) - 1, -1, -1):
            a, b, share = within[k]
            inner = kappa * sum(d * (y - x) for x, y, d in within[:k])
            if sign * (inner + sign * kappa * (overlap - a) - target) >= 0.0:
                # inner + kappa share (q - a) + sign kappa (d - q) = target within this piece
                gap = sign * kappa - kappa * share
                q = a if gap == 0.0 else min(max((inner - kappa * share * a + sign * kappa * overlap - target) / gap, a), b)
                self.pieces = [*within[:k], (a, q, share), (q, overlap, sign)]
                return
        self.pieces = [(0.0, overlap, sign)]

    def _content(self, end):
        return sum(share * (min(b, end) - a) for a, b, share in self.pieces if a < end)

    def _cut(self, end):
        return [(a, min(b, end), share) for a, b, share in self.pieces if a < end]

    @property
    def force(self):
        """T in the sense of the slip."""
        return self.mu * self.stiffness * sum(share * (b**1.5 - a**1.5) for a, b, share in self.pieces)

    @property
    def limit(self):
        return self.mu * self.stiffness * max(self.overlap, 0.0) ** 1.5
