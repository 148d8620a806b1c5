"""Where the papers' figures come from."""

ALLSHIRE = "Allshire et al. 2021, arXiv 2108.09779, abstract and s2r2-ig.github.io"
DACTYL = "OpenAI et al. 2018, arXiv 1808.00177"
DACTYL_PAGE = "openai.com/index/learning-dexterity (2018)"
DAPG = "Rajeswaran et al. 2017, arXiv 1709.10087, abstract"
