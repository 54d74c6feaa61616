"""A language model plans, the policy acts (A.13): a vague goal becomes sentences that a policy can carry out.

`belonging` says whether a name belongs to a kind, `naming` what lies on a table, `goals` what a vague goal asks for,
`planner` which sentence comes next.
"""
