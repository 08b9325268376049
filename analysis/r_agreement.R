# The interaction of groups and conditions once more, by other functions than the report's script uses: pbkrtest's comparison
# of two models, and base R's analysis of variance with Greenhouse and Geisser's correction. Run in the report's folder.
suppressPackageStartupMessages(library(lme4))

cells <- read.csv("cells.csv", na.strings = "", colClasses = c(group = "character", participant = "character", condition = "character"))
wide <- reshape(cells, idvar = c("group", "participant"), timevar = "condition", direction = "wide")
values <- as.matrix(wide[, -(1:2)])
has_all <- stats::complete.cases(values)
values <- values[has_all, ]
group <- factor(wide$group[has_all])
cells <- cells[cells$participant %in% wide$participant[has_all], ]

full <- lmer(value ~ group * condition + (1 | participant), cells)
without <- lmer(value ~ group + condition + (1 | participant), cells)
kenward_roger <- pbkrtest::KRmodcomp(full, without)$test["Ftest", ]
within <- data.frame(condition = factor(seq_len(ncol(values))))
spherical <- anova(lm(values ~ group), X = ~1, idata = within, test = "Spherical")["group", ]
write.csv(data.frame(
  kr_f = kenward_roger$stat, kr_df = kenward_roger$ddf, kr_p = kenward_roger$p.value,
  aov_f = spherical[["F"]], gg_p = spherical[["G-G Pr"]]
), "reference_r.csv", row.names = FALSE)
packages <- c("lme4", "lmerTest", "pbkrtest", "emmeans", "afex", "glmmTMB")
versions <- vapply(packages, function(name) as.character(utils::packageVersion(name)), "")
write.csv(data.frame(package = c("R", packages), version = c(as.character(getRversion()), versions)), "versions_r.csv", row.names = FALSE)
